"""rl-zoo's own commands on our files."""

import subprocess
import sys
from pathlib import Path

import pytest
import torch as th
import yaml
from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, PPO

from sb3_guide.experiments.stages.configs import FOLDERS, algorithm_arguments
from sb3_guide.experiments.stages.expert import train_expert
from sb3_guide.policies import load_agent

KEY = "GuideGrid-GoToObj-v0"
TINY = {
    "policy": "LearnerPolicy",
    "n_envs": 4,
    "n_timesteps": 256,
    "n_steps": 16,
    "batch_size": 32,
    "n_epochs": 2,
    "learning_rate": "lin_0.001",
    "callback": [
        {"sb3_guide.callbacks.StopTrainingOnSuccessRate": {"success_rate": 1.0, "n_episodes": 1000}},
        {
            "sb3_guide.callbacks.Curriculum": {
                "parts": [{"level": "GoToObjMazeS4", "n_timesteps": 128}, {"level": "GoToObj", "n_timesteps": 256}]
            }
        },
    ],
}
ALGORITHMS = {
    "ppo": PPO,
    "ppo_lstm": RecurrentPPO,
    "a2c": A2C,
    "ppo_guide": PPO,
    "ppo_lstm_guide": RecurrentPPO,
}
PAPER = ("GoToObj", "GoToLocal", "GoToObjMaze", "PickupLoc", "PutNextLocal", "GoTo")
LEVELS = {"ppo_lstm_guide": ("GoToLocal",)}  # of files that don't hold all of them


def zoo(command: str, folder: Path, *arguments: str) -> str:
    program = [sys.executable, "-m", f"rl_zoo3.{command}", "--algo", "ppo", "--env", KEY, "--gym-packages", "sb3_guide"]
    done = subprocess.run([*program, "-f", str(folder), *arguments], capture_output=True, text=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("zoo") / "tiny.yml"
    path.write_text(yaml.safe_dump({KEY: TINY}))
    return path


def test_the_zoo_trains_the_same_expert_and_plays_it(config, tmp_path):
    zoo("train", tmp_path, "--conf-file", str(config), "--seed", "5", "--eval-freq", "-1")
    train_expert("GoToObj", tmp_path / "ours", seed=5, threads=1, resume=False, config_file=config, algo="ppo")
    theirs = PPO.load(tmp_path / "ppo" / f"{KEY}_1" / f"{KEY}.zip").policy.state_dict()
    for name, weight in load_agent(tmp_path / "ours").state_dict().items():
        assert th.equal(weight, theirs[name]), name
    assert "Success rate" in zoo("enjoy", tmp_path, "--no-render", "-n", "130")


def test_the_zoo_tunes_it(config, tmp_path):
    arguments = ["-optimize", "--n-trials", "1", "--n-evaluations", "1", "--eval-episodes", "1", "-n", "128"]
    said = zoo("train", tmp_path, "--conf-file", str(config), *arguments, "--sampler", "random", "--pruner", "none")
    assert "Best trial" in said


@pytest.mark.parametrize("name", ALGORITHMS)
def test_our_files_hold_the_levels_that_they_are_for(name):
    entries = yaml.safe_load((FOLDERS[1] / f"{name}.yml").read_text())
    assert set(entries) >= {f"GuideGrid-{level}-v0" for level in LEVELS.get(name, PAPER)}
    for key, entry in entries.items():
        ALGORITHMS[name](entry["policy"], key, _init_setup_model=True, **{**algorithm_arguments(entry), "n_steps": 8})


@pytest.mark.parametrize("schedule", ["exp_0.1", "lin_", "0.001"])
def test_an_unknown_schedule(schedule):
    with pytest.raises(ValueError, match=f"schedule '{schedule}' is unknown"):
        algorithm_arguments({"learning_rate": schedule})
