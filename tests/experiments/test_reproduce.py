import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import pytest
from typer.core import TyperGroup
from typer.main import get_command

from sb3_guide.experiments.cli import app
from sb3_guide.experiments.reproduce import reproduce
from sb3_guide.experiments.workflow import running as module
from sb3_guide.experiments.workflow.running import RUN_VARIABLE, end_leftovers, locked

FAKE = Path(__file__).with_name("fake_stages.py")
PACKAGED = module.SNAKEFILE


@pytest.fixture(scope="session")
def workflow(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packaged Snakefile, with stages that take a moment each."""
    folder = tmp_path_factory.mktemp("workflow")
    interpreter, snakefile = folder / "python", folder / "Snakefile"
    interpreter.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{FAKE}" "$@"\n')
    interpreter.chmod(0o755)
    snakefile.write_text(f'import sys\n\nsys.executable = "{interpreter}"\n\n\ninclude: "{module.SNAKEFILE}"\n')
    return snakefile


COMPILED = ("true",)  # instead of the process that compiles the engine


@pytest.fixture(autouse=True)
def fake_stages(workflow: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SNAKEFILE", workflow)
    monkeypatch.setattr(module, "COMPILE", COMPILED)


@pytest.fixture(scope="session")
def finished(workflow: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run that nothing disturbs."""
    folder = tmp_path_factory.mktemp("undisturbed")
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(module, "SNAKEFILE", workflow)
        monkeypatch.setattr(module, "COMPILE", COMPILED)
        reproduce("stages", ["GoToObj"], seeds=1, cores=2, out=folder)
    return folder


@pytest.fixture
def copy(finished: Path, tmp_path: Path) -> Path:
    """A copy of that folder, with its times and Snakemake's notes."""
    return shutil.copytree(finished, tmp_path / "copy")


@pytest.fixture(scope="session")
def undisturbed(finished: Path) -> dict[str, Any]:
    """Summary of that run."""
    return summary_of(finished)


def summary_of(folder: Path) -> dict[str, Any]:
    """The summary without its times."""
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return {key: value for key, value in summary.items() if not key.endswith("seconds")}


def start(workflow: Path, folder: Path, seconds: float) -> "subprocess.Popen[bytes]":
    """Reproduce as make does, in a child of the process that is returned, with stages of so many seconds."""
    code = (
        "from pathlib import Path; from sb3_guide.experiments.reproduce import reproduce;"
        "from sb3_guide.experiments.workflow import running as module;"
        f"module.SNAKEFILE, module.COMPILE = Path({str(workflow)!r}), {COMPILED!r};"
        f"reproduce('stages', ['GoToObj'], 1, 2, Path({str(folder)!r}))"
    )
    environment = {**os.environ, "FAKE_SECONDS": str(seconds)}
    make = ["sh", "-c", '"$@"; exit $?', "make", sys.executable, "-c", code]
    return subprocess.Popen(make, env=environment, stderr=subprocess.PIPE, start_new_session=True)


def wait_for(path: Path, process: "subprocess.Popen[bytes]") -> None:
    while not path.exists():
        assert process.poll() is None, process.stderr and process.stderr.read().decode()
        time.sleep(0.02)


def processes_of(folder: Path) -> list[psutil.Process]:
    return [
        process
        for process in psutil.process_iter(["environ"])
        if (process.info["environ"] or {}).get(RUN_VARIABLE) == str(folder)
    ]


def test_a_run_ends_with_its_summary(undisturbed: dict[str, Any]) -> None:
    assert undisturbed["level"] == "GoToObj"
    assert undisturbed["seeds"] == [0]


def test_one_core_gives_the_same_summary_and_seeds_can_be_added(undisturbed: dict[str, Any], tmp_path: Path) -> None:
    reproduce("stages", ["GuideGrid-GoToObj-v0", "GoToObj"], seeds=1, cores=1, out=tmp_path)
    assert summary_of(tmp_path) == undisturbed
    finished = tmp_path / "GoToObj" / "seed0" / "guided" / "run.json"
    before = finished.stat().st_mtime_ns
    reproduce("stages", ["GoToObj"], seeds=2, cores=2, out=tmp_path)
    assert finished.stat().st_mtime_ns == before
    assert summary_of(tmp_path)["seeds"] == [0, 1]
    analyses = {agent: tmp_path / "GoToObj" / "seed1" / "analysis" / agent / "analysis.json" for agent in ("guide", "guided")}
    heard = {agent: json.loads(path.read_text())["guide"] for agent, path in analyses.items()}
    assert heard == {"guide": None, "guided": "GoToObj/seed1/guide"}  # whose words' meanings are compared with the Guide's


def test_a_run_that_is_killed_again_and_again_ends_with_the_same_summary(
    workflow: Path, undisturbed: dict[str, Any], tmp_path: Path
) -> None:
    def until(stage: str, seconds: float = 0.5) -> "subprocess.Popen[bytes]":
        process = start(workflow, tmp_path, seconds)
        wait_for(tmp_path / "log" / "GoToObj" / f"{stage}.log", process)
        return process

    process = until("expert", seconds=60)
    (caller,) = psutil.Process(process.pid).children()
    process.kill()  # alone: what it called goes on
    process.wait()
    assert caller.is_running()
    process = until("demos/validation")
    assert not caller.is_running()
    psutil.Process(process.pid).children()[0].kill()  # alone: Snakemake and a stage go on
    process.wait()
    process = until("seed0/guide")
    (snakemake,) = (each for each in processes_of(tmp_path) if "snakemake" in each.cmdline())
    snakemake.kill()  # its caller then ends by itself, and what it called
    assert process.wait() == 1
    assert processes_of(tmp_path) == []
    process = until("seed0/guided", seconds=3)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    process = until("seed0/analysis/guided")  # which no earlier call can have begun
    (caller,) = psutil.Process(process.pid).children()
    os.killpg(process.pid, signal.SIGINT)
    process.wait()
    psutil.wait_procs([caller], timeout=20)  # the shell that called it doesn't wait for it
    assert processes_of(tmp_path) == []
    reproduce("stages", ["GoToObj"], seeds=1, cores=2, out=tmp_path)
    assert summary_of(tmp_path) == undisturbed


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_that_is_asked_to_end_leaves_nothing_running(number: signal.Signals, workflow: Path, tmp_path: Path) -> None:
    process = start(workflow, tmp_path, seconds=60)
    wait_for(tmp_path / "log" / "GoToObj" / "expert.log", process)
    (caller,) = psutil.Process(process.pid).children()
    for _ in range(3):  # whoever is impatient asks again
        caller.send_signal(number)
    assert process.wait(timeout=20) in (1, 128 + number)
    assert processes_of(tmp_path) == []
    with locked(tmp_path):
        pass


def test_a_clock_that_was_set_back_changes_nothing(undisturbed: dict[str, Any], copy: Path) -> None:
    tomorrow = time.time() + 24 * 3600
    for path in [*(copy / "GoToObj" / "demos").iterdir(), *(copy / "GoToObj" / "expert").iterdir()]:
        os.utime(path, (tomorrow, tomorrow))  # these were written before it was
    reproduce("stages", ["GoToObj"], seeds=1, cores=2, out=copy)
    assert summary_of(copy) == undisturbed


def test_what_a_killed_run_left_is_ended_and_nothing_else(tmp_path: Path) -> None:
    for name in ("run", "other"):
        subprocess.Popen(["sleep", "60"], env={**os.environ, RUN_VARIABLE: str(tmp_path / name)})
    while not all(processes_of(tmp_path / name) for name in ("run", "other")):
        time.sleep(0.01)  # the kernel shows a process before its environment
    end_leftovers(tmp_path / "run")
    assert processes_of(tmp_path / "run") == []
    assert len(processes_of(tmp_path / "other")) == 1
    end_leftovers(tmp_path / "other")


def test_a_failing_stage_shows_the_end_of_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FAKE_FAILURE", "guide")
    with pytest.raises(RuntimeError, match="failed: GoToObj/seed0/guide"):
        reproduce("stages", ["GoToObj"], seeds=1, cores=2, out=tmp_path)
    shown = capsys.readouterr().err
    assert "GoToObj/seed0/guide: FAILED" in shown
    assert "made of cheese" in shown
    assert str(tmp_path / "log" / "GoToObj" / "seed0" / "guide.log") in shown
    monkeypatch.delenv("FAKE_FAILURE")
    reproduce("stages", ["GoToObj"], seeds=1, cores=2, out=tmp_path)
    assert (tmp_path / "report.html").exists()


def test_that_the_engine_compiles_is_told_and_counted(
    copy: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module, "COMPILE", ("sh", "-c", "echo compiling the engine; sleep 2"))
    reproduce("stages", ["GoToObj"], seeds=1, cores=2, out=copy)
    out, err = capsys.readouterr()
    assert "compiling the engine\nengine: compiled in 2 s" in err
    assert "compiling the engine, once on this machine, 0:02" in out
    assert re.search(r"The run took 0:\d\d .*Expert \(stage 1\) 0:2\d", out)


def test_an_engine_that_does_not_compile_is_told(
    copy: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module, "COMPILE", ("sh", "-c", "echo no compiler; exit 1"))
    reproduce("stages", ["GoToObj"], seeds=1, cores=2, out=copy)  # the stages, which would try themselves, don't need it here
    assert f"engine: did not compile, see {copy / 'log' / 'engine.log'}" in capsys.readouterr().err


def test_a_study_of_channels_ends_with_its_page(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yml"
    mine.write_text(
        "studies: {small: {page: channel, speak: [guide, guided],"
        " grids: [{levels: [GoToObj], conditions: [learner, guided, guided-1x2], seeds: 2}]}}"
    )
    reproduce("small", [], seeds=None, cores=2, out=tmp_path / "run", conditions=mine)
    page = (tmp_path / "run" / "report" / "README.md").read_text()
    assert page.startswith("# How much language?")
    assert "| 2 x 3 | guided Learner | 2.0 ± 0.0 | 1.8 ± 0.0 | 2.0 ± 0.0 | 2.0 ± 0.0 | 90.0 ± 0.0 | 80.0 ± 0.0 |" in page


@pytest.mark.parametrize(("study", "level", "count"), [("stages", "GoToObj", 10), ("channel", "GoToLocal", 2 + 31 + 24)])
def test_the_workflow_speaks_the_command_line_of_the_stages(study: str, level: str, count: int, tmp_path: Path) -> None:
    config = [f"study={study}", f"levels=[{level}]", "seeds=1"]
    options = ["--directory", str(tmp_path), "--config", *config, "--dry-run", "--printshellcmds"]
    snakemake = [sys.executable, "-m", "snakemake", "all", "--snakefile", str(PACKAGED), *options]
    planned = subprocess.run(snakemake, check=True, capture_output=True, text=True).stdout
    calls = re.findall(r"-m sb3_guide\.experiments\.cli (.*) > log/", planned)
    assert len(calls) == count
    stages = get_command(app)
    assert isinstance(stages, TyperGroup)
    for name, *arguments in map(shlex.split, calls):
        stages.commands[name].make_context(name, arguments)  # complains of what it doesn't know


def test_two_runs_in_one_folder_are_refused(tmp_path: Path) -> None:
    with locked(tmp_path):
        for owner in ((tmp_path / ".owner.json").read_text(), "{}", '{"pid": "me"}', "{"):
            (tmp_path / ".owner.json").write_text(owner)
            with pytest.raises(RuntimeError, match="in use by another reproduce"):
                reproduce("stages", ["GoToObj"], seeds=1, cores=1, out=tmp_path)


def test_a_folder_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RuntimeError, match="can't be used"):
        reproduce("stages", ["GoToObj"], seeds=1, cores=1, out=tmp_path / "file")


@pytest.mark.parametrize(
    ("levels", "seeds", "cores", "message"),
    [
        (["GoToTheMoon"], 1, 1, "GoToTheMoon"),
        (["GoToObj", "BossLevel"], 1, 1, "no entry GuideGrid-BossLevel-v0"),
        ([], 1, 1, "at least one to be named, such as GoToObj"),
        (["GoToObj"], 0, 1, "seeds is 0"),
        (["GoToObj"], 1, -1, "cores is -1"),
    ],
)
def test_wrong_arguments_are_refused_before_anything_is_made(
    levels: list[str], seeds: int, cores: int, message: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message):
        reproduce("stages", levels, seeds, cores, tmp_path / "run")
    assert not (tmp_path / "run").exists()
