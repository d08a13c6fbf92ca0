"""The experts that are shipped."""

import numpy as np
import pytest
import torch as th
from stable_baselines3 import PPO
from typer.testing import CliRunner

from sb3_guide import experts, load_expert
from sb3_guide.cloning import load_demonstrations, mission_seeds, play
from sb3_guide.experiments.cli import app
from sb3_guide.files import read_json
from sb3_guide.policies import load_agent

SHIPPED = sorted(path.parent.name for path in experts.FOLDER.glob("*/agent.json"))


@pytest.mark.parametrize("level", SHIPPED)
def test_an_expert_plays_as_its_card_says(level):
    model, evaluation = load_expert(level), read_json(experts.expert_folder(level) / "evaluation.json")
    success_rate = evaluation["greedy"]["success_rate"]
    successes = play(model.policy, level, mission_seeds("validation", 200)).successes.mean()
    assert successes == pytest.approx(success_rate, abs=4 * np.sqrt(success_rate * (1 - success_rate) / 200) + 0.01)
    assert f"{success_rate:.1%}" in (experts.FOLDER / level / "README.md").read_text()


def test_it_is_a_model_that_plays_and_can_be_trained_further():
    model = load_expert("GuideGrid-GoToObj-v0", n_envs=4)
    assert isinstance(model, PPO)
    venv = model.get_env()
    actions, _ = model.predict(venv.reset(), deterministic=True)
    assert venv.step(actions)[1].shape == (4,)
    before = load_agent(experts.expert_folder("GoToObj")).state_dict()
    assert all(th.equal(weight, before[name]) for name, weight in model.policy.state_dict().items())
    model.n_steps = model.rollout_buffer.buffer_size = 16
    model.rollout_buffer.reset()
    model.learn(64)
    assert model.num_timesteps == 64


def test_demonstrations_of_a_shipped_expert(tmp_path):
    out = tmp_path / "train.safetensors"
    arguments = ["record", "--level", "GoToObj", "--expert", "pretrained", "--episodes", "5", "--out", str(out)]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert load_demonstrations(out).episodes.successes.all()


def test_a_level_without_an_expert():
    with pytest.raises(ValueError, match=r"no trained expert for BossLevel: expected one of .*GoToObj"):
        load_expert("BossLevel")
