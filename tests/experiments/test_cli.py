"""The command line as a newcomer meets it."""

import subprocess
import sys

import pytest
from typer.testing import CliRunner

from sb3_guide.experiments import reproduce
from sb3_guide.experiments.cli import Page, app, main
from sb3_guide.experiments.stages.configs import load_config
from sb3_guide.experiments.workflow import conditions
from sb3_guide.experts import expert_folder

COMMANDS = ("expert", "record", "clone", "evaluate", "analyze", "ablate", "speak", "reproduce")


def test_help_names_every_stage():
    shown = CliRunner().invoke(app, ["--help"]).output
    assert all(command in shown for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_stage_explains_itself(command):
    shown = CliRunner().invoke(app, [command, "--help"])
    assert shown.exit_code == 0
    assert "--out" in shown.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["expert", "--level", "GoToMars", "--out", "x"], "GoToMars"),
        (["evaluate", "nowhere", "--level", "GoToObj", "--out", "x.json"], "nowhere is no agent's folder"),
        (["evaluate", "nowhere", "--level", "GoToObj", "--out", "x.json", "--episodes", "0"], "0 episodes were asked for"),
        (["speak", "pretrained", "--out", "x"], "which of the shipped agents? expected --level"),
        (["speak", "pretrained", "--level", "BossLevel", "--out", "x"], "there is no trained guided for BossLevel"),
        (["speak", "nowhere", "--level", "GoToObj", "--out", "x"], "nowhere is no agent's folder"),
        (["ablate", "pretrained", "--level", "GoToObj", "--episodes", "0", "--out", "x.json"], "expected at least 2"),
    ],
)
def test_wrong_use_ends_with_one_line(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["sb3-guide", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert isinstance(ended.value.code, str)  # which Python prints, and ends with 1
    assert message in ended.value.code
    assert "\n" not in ended.value.code
    assert not list(tmp_path.iterdir())


def test_a_process_that_was_used_wrongly_says_that_line_last(tmp_path):
    command = [sys.executable, "-m", "sb3_guide.experiments.cli", "expert", "--level", "GoToMars", "--out", "x"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert ended.returncode != 0
    assert "Traceback" not in ended.stderr
    assert "GoToMars" in ended.stderr.splitlines()[-1]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments",
    [
        ["expert", "--level", "GoToObj", "--out", "/sys/run"],
        ["record", "--level", "GoToObj", "--expert", "pretrained", "--episodes", "1", "--out", "/sys/run/train.safetensors"],
        ["evaluate", str(expert_folder("GoToObj")), "--level", "GoToObj", "--episodes", "1", "--out", "/sys/run.json"],
        ["reproduce", "GoToObj", "--out", "/sys/run"],
    ],
)
def test_a_folder_that_cannot_be_written_to(arguments, monkeypatch):
    """Even root can make nothing there."""
    monkeypatch.setattr(sys, "argv", ["sb3-guide", *arguments])
    with pytest.raises(SystemExit, match=r"^sb3-guide: .*(not permitted|denied).*/sys/run"):
        main()


@pytest.mark.parametrize("name", ["ppo", "bc"])
@pytest.mark.parametrize("level", ["GoToObj", "GoToLocal"])
def test_every_level_has_its_hyper_parameters(name, level):
    assert load_config(name, level)


KEY = "GuideGrid-GoToObj-v0"


def test_configs_that_cannot_be_read(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.yml is no file"):
        load_config("ppo", "GoToObj", tmp_path / "none.yml")
    for content, message in (
        ("a: [", "is no YAML"),
        ("a: 1", "has no entry GuideGrid-GoToObj-v0: it has a"),
        ("", "it has none"),
        (f"{KEY}: {{policy: LearnerPolicy, n_envs: 4}}", "lacks n_timesteps"),
        (f"{KEY}: {{policy: LearnerPolicy, n_envs: {10**9}, n_timesteps: 1}}", "n_envs=1000000000: expected a whole number"),
        (f"{KEY}: {{policy: LearnerPolicy, n_envs: 4.5, n_timesteps: 1}}", "n_envs=4.5: expected a whole number"),
    ):
        (tmp_path / "some.yml").write_text(content)
        with pytest.raises(ValueError, match=message):
            load_config("ppo", "GoToObj", tmp_path / "some.yml")
    (tmp_path / "some.yml").write_text(f"{KEY}: {{policy: LearnerPolicy, n_envs: 4, n_timesteps: !!float 1e6, gamma: 1e-1}}")
    config = load_config("ppo", "GoToObj", tmp_path / "some.yml")
    assert (repr(config["n_timesteps"]), config["gamma"]) == ("1000000", 0.1)  # as rl-zoo itself takes them


def test_every_page_of_a_study_can_be_asked_for() -> None:
    assert [page.value for page in Page] == list(conditions.PAGES) == list(reproduce.PAGES)
