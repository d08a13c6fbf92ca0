"""
What becomes of runs that are killed: `python -m benchmarks.kills --kills 100 --out docs/results/kills.json`

Every stage, as small as can be, is killed with SIGKILL at random moments, called again, killed again, until it ends; then its
files must be those of a run that nobody disturbed, bit by bit, but for the times and commands that they tell. So must the
summary of `reproduce` be, the whole workflow of which is asked to end by SIGINT or SIGTERM, or is killed alone or with all its
processes, and which must leave none of them running. Its stages are the tests' stand-ins, which write files of the same
formats in a moment, as it is the workflow that is killed there; `--real` takes the true ones. The moments are functions of
stage and seed, in parts of the time that an undisturbed run takes.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
import json
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import yaml
from tqdm import tqdm

import sb3_guide
from sb3_guide.experiments.stages.analyze import analyze
from sb3_guide.experiments.stages.clone import clone
from sb3_guide.experiments.stages.evaluate import evaluate
from sb3_guide.experiments.stages.expert import train_expert
from sb3_guide.experiments.stages.record import record_demonstrations
from sb3_guide.experiments.stages.speak import speak_to
from sb3_guide.experiments.workflow.running import RUN_VARIABLE, SNAKEFILE
from sb3_guide.experts import expert_folder
from sb3_guide.files import read_json, write_json
from sb3_guide.speakers import speaker_folder

KEY = "GuideGrid-GoToObj-v0"
ROOM = {"policy": "LearnerPolicy", "n_envs": 16, "n_timesteps": 128 * 40, "n_steps": 8, "batch_size": 64, "n_epochs": 1}
BC = {
    **{"recorded_episodes": 40, "train_episodes": 40, "validation_episodes": 8, "analysis_episodes": 20, "n_epochs": 6},
    **{"validate_every": 1, "validate_at": [0, 0.5], "batch_size": 8, "learning_rate": "lin_0.001", "ent_weight": 0.01},
}
OF_THE_DAY = ("seconds", "finished", "command", "stage_seconds", "wall_seconds")  # what differs between equal runs
AIDS = ("lock", "checkpoint", "tensorboard", ".partial")  # in names of files and folders that are no results
SLOWER = 1.1  # moments are drawn from so many times an undisturbed run's time
FAKE = Path(__file__).parents[1] / "tests" / "experiments" / "fake_stages.py"


def stages(inputs: Path) -> dict[str, Callable[[Path], None]]:
    """
    :param inputs: folder with ppo.yml, bc.yml and demonstrations
    :return: what each stage does to a folder, by its name
    """
    speaker = speaker_folder("GoToObj", "guided")
    return {
        "expert": lambda out: train_expert("GoToObj", out, 0, 1, resume=True, config_file=inputs / "ppo.yml"),
        "record": lambda out: record_demonstrations(
            "GoToObj", expert_folder("GoToObj"), "train", 400, out / "train.safetensors", 1
        ),
        "clone": lambda out: clone("guide", "GoToObj", [inputs], out, 0, 1, resume=True, config_file=inputs / "bc.yml"),
        "evaluate": lambda out: evaluate(speaker, "GoToObj", 300, out / "evaluation.json", 1),
        "analyze": lambda out: analyze(speaker, "GoToObj", None, None, out, 1, n_episodes=40),
        "speak": lambda out: speak_to(speaker, "GoToObj", ["forward", "forward"], None, False, out, 0, 1),
    }


def prepare(inputs: Path) -> None:
    """Write what the stages read."""
    for name, entry in (("ppo", ROOM), ("bc", BC)):
        (inputs / f"{name}.yml").write_text(yaml.safe_dump({KEY: entry}))
    for split in ("train", "validation"):
        record_demonstrations("GoToObj", expert_folder("GoToObj"), split, 40, inputs / f"{split}.safetensors", 1)


def results(folder: Path) -> dict[str, str]:
    """:return: SHA-256 of every file that is a result, without times, by name"""
    return {
        str(path.relative_to(folder)): hashlib.sha256(timeless(path)).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not any(aid in part for aid in AIDS for part in path.relative_to(folder).parts)
    }


def timeless(path: Path) -> bytes:
    """:return: content of a file without what tells of its day"""
    if path.suffix == ".json":
        return json.dumps(without_times(json.loads(path.read_text()))).encode()
    if path.suffix == ".csv":
        rows = csv.DictReader(io.StringIO(path.read_text()))
        return json.dumps(
            [{k: v for k, v in row.items() if k not in OF_THE_DAY and "time/" not in k} for row in rows]
        ).encode()
    return path.read_bytes()


def without_times(content: Any) -> Any:
    """:return: JSON without what tells of its day"""
    if isinstance(content, dict):
        return {key: without_times(value) for key, value in content.items() if key not in OF_THE_DAY}
    return [without_times(each) for each in content] if isinstance(content, list) else content


class Call:
    """
    A stage at work in a process of its own.

    :param stage: what to do
    :param folder: in which it works, as the present one, so that what it writes knows no other name of it
    """

    def __init__(self, stage: Callable[[Path], None], folder: Path) -> None:
        self.pid = os.fork()
        if not self.pid:
            status = 1
            try:
                os.chdir(folder)
                quiet = os.open(folder.with_name("log"), os.O_WRONLY | os.O_CREAT | os.O_APPEND)
                os.dup2(quiet, 1)
                os.dup2(quiet, 2)
                stage(Path("out"))
                status = 0
            finally:
                os._exit(status)

    def wait(self, seconds: float | None) -> bool:
        """:return: whether it ended well; it is killed when its time is over"""
        end = np.inf if seconds is None else time.monotonic() + seconds
        while time.monotonic() < end:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                if status:
                    raise RuntimeError(f"a stage failed by itself: status {status}")
                return True
            time.sleep(0.002)
        os.kill(self.pid, signal.SIGKILL)
        return os.waitpid(self.pid, 0)[1] == 0  # it may have ended just now


def kill_stage(name: str, stage: Callable[[Path], None], kills: int, work: Path) -> dict[str, Any]:
    """
    :param name: of the stage
    :param stage: what it does to a folder
    :param kills: how many
    :param work: folder for all of it
    :return: how many runs they fell upon, and how many of these ended otherwise than an undisturbed one
    """
    rng, undisturbed = np.random.default_rng([len(name), *name.encode()]), work / "undisturbed"
    undisturbed.mkdir(parents=True)
    began = time.monotonic()
    Call(stage, undisturbed).wait(None)
    seconds, expected = time.monotonic() - began, results(undisturbed)
    done = runs = different = 0
    with tqdm(total=kills, desc=name, unit="kill", mininterval=5) as progress:
        while done < kills:
            folder = work / str(runs)
            folder.mkdir()
            while done < kills and not Call(stage, folder).wait(rng.uniform(0, SLOWER * seconds)):
                done += 1
                progress.update()
            Call(stage, folder).wait(None)
            runs, different = runs + 1, different + (results(folder) != expected)
    return {"kills": done, "runs": runs, "different": different, "files": len(expected), "seconds": round(seconds, 1)}


# The workflow -------------------------------------------------------------------------------------------------------------


def programs(work: Path, real: bool) -> tuple[list[str], dict[str, str]]:
    """:return: command line, but for its folder, and environment of a `reproduce` with stages as small as can be"""
    if real:
        (work / "zoo_configs").mkdir()
        for name, entry in (("ppo", ROOM), ("bc", BC)):
            (work / "zoo_configs" / f"{name}.yml").write_text(yaml.safe_dump({KEY: entry}))
        (work / "sb3_guide").symlink_to(Path(sb3_guide.__file__).parent)
        call = "from sb3_guide.experiments.cli import main; main()"
    else:
        interpreter, snakefile = work / "python", work / "Snakefile"
        interpreter.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {shlex.quote(str(FAKE))} "$@"\n')
        interpreter.chmod(0o755)
        snakefile.write_text(f'import sys\n\nsys.executable = "{interpreter}"\n\n\ninclude: "{SNAKEFILE}"\n')
        call = (
            "from pathlib import Path; from sb3_guide.experiments.workflow import running;"
            f"running.SNAKEFILE = Path({str(snakefile)!r}); from sb3_guide.experiments.cli import main; main()"
        )
    study = ["reproduce", "GoToObj", "--seeds", "1", "--cores", "2", "--out", "out"]
    path = f"{work}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    return [sys.executable, "-c", call, *study], {**os.environ, "PYTHONPATH": path, "FAKE_SECONDS": "0.3"}


def running(folder: Path) -> set[int]:
    """:return: numbers of the processes of a run"""
    processes = psutil.process_iter(["environ"])
    return {each.pid for each in processes if (each.info["environ"] or {}).get(RUN_VARIABLE) == str(folder / "out")}


def kill_workflow(kills: int, work: Path, real: bool) -> dict[str, Any]:
    """As :func:`kill_stage`, of the whole workflow."""
    rng = np.random.default_rng(0)
    work.mkdir()
    command, environment = programs(work, real)

    def begin(folder: Path) -> subprocess.Popen[bytes]:
        folder.mkdir(exist_ok=True)
        log = (folder / "log").open("ab")
        return subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=log, start_new_session=True)

    began = time.monotonic()
    if begin(work / "undisturbed").wait():
        raise RuntimeError(f"it failed by itself: see {work / 'undisturbed' / 'log'}")
    seconds, expected = time.monotonic() - began, timeless(work / "undisturbed" / "out" / "summary.json")
    done = runs = different = left = failed = 0
    with tqdm(total=kills, desc="reproduce", unit="kill", mininterval=5) as progress:
        while done < kills:
            folder, ended = work / str(runs), False
            while done < kills and not ended:
                before = running(folder)  # left by a SIGKILL, and not this call's doing if it is ended before it has begun
                process = begin(folder)
                try:
                    failed += process.wait(rng.uniform(0, SLOWER * seconds)) != 0
                    ended = True
                except subprocess.TimeoutExpired:
                    how = int(rng.integers(4))
                    if how < 3:
                        process.send_signal([signal.SIGINT, signal.SIGTERM, signal.SIGKILL][how])
                    else:
                        os.killpg(process.pid, signal.SIGKILL)
                    process.wait()
                    left += len(running(folder) - before) if how < 2 else 0
                    done += 1
                    progress.update()
            failed += begin(folder).wait() != 0
            different += timeless(folder / "out" / "summary.json") != expected
            runs += 1
    numbers = {"kills": done, "runs": runs, "different": different, "left_running": left, "failed": failed}
    return {**numbers, "seconds": round(seconds, 1)}


def main() -> None:
    """Kill, print the numbers, write them down; the exit status is 1 if a run ended otherwise or left something running."""
    parser = argparse.ArgumentParser(description="Kill every stage and the workflow at random moments.")
    names = [*stages(Path()), "reproduce"]
    parser.add_argument("--kills", type=int, default=100, help="of each")
    parser.add_argument("--stages", nargs="+", choices=names, default=names)
    parser.add_argument("--real", action="store_true", help="reproduce with the true stages")
    parser.add_argument("--out", type=Path, help="JSON file for the numbers; those of other stages in it stay")
    arguments = parser.parse_args()
    fine = True
    with tempfile.TemporaryDirectory(prefix="kills") as folder:
        inputs = Path(folder) / "inputs"
        inputs.mkdir()
        Call(lambda _: prepare(inputs), Path(folder)).wait(None)  # torch is not to be used before processes are forked
        for name in arguments.stages:
            if name == "reproduce":
                numbers = kill_workflow(arguments.kills, Path(folder) / name, arguments.real)
            else:
                numbers = kill_stage(name, stages(inputs)[name], arguments.kills, Path(folder) / name)
            print(name, numbers, flush=True)
            if arguments.out:
                known = read_json(arguments.out) if arguments.out.exists() else {}
                write_json(arguments.out, {**known, name: numbers})
            fine = fine and not any(numbers.get(bad) for bad in ("different", "left_running", "failed"))
    sys.exit(not fine)


if __name__ == "__main__":
    main()
