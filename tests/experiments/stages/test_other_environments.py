"""Every stage in an environment that is not ours."""

from unittest.mock import patch

import gymnasium
import minigrid  # noqa: F401  # registers its environments
import numpy as np
import pytest
import torch as th
import yaml

from sb3_guide.cloning import Demonstrations, Episodes, save_demonstrations
from sb3_guide.experiments.stages.ablate import ablate_agent
from sb3_guide.experiments.stages.analyze import analyze
from sb3_guide.experiments.stages.clone import clone
from sb3_guide.experiments.stages.evaluate import evaluate
from sb3_guide.experiments.stages.expert import train_expert
from sb3_guide.experiments.stages.levels import environment, split_levels
from sb3_guide.experiments.stages.record import record_demonstrations
from sb3_guide.experiments.stages.speak import speak_to
from sb3_guide.files import read_json
from sb3_guide.language.animation import drawn
from sb3_guide.policies import load_agent, save_agent

PICK = "tests.toys:Pick-v0"
DOOR_KEY = "MiniGrid-DoorKey-5x5-v0"
PPO = {"policy": "LearnerPolicy", "n_envs": 4, "n_timesteps": 64, "n_steps": 16, "batch_size": 64}
BC = {
    "train_episodes": 200,
    "validation_episodes": 5,
    "analysis_episodes": 20,
    "n_epochs": 10,
    "validate_every": 10,
    "validate_at": [],
    "batch_size": 10,
    "learning_rate": 0.001,
    "ent_weight": 0.01,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Configurations, and demonstrations of somebody who knows how to pick."""
    folder = tmp_path_factory.mktemp("pick")
    for name, config in (("ppo", PPO), ("bc", BC)):
        (folder / f"{name}.yml").write_text(yaml.safe_dump({"Pick-v0": config}))
    rng = np.random.default_rng(0)
    for split, count in (("train", 200), ("validation", 5)):
        missions = rng.integers(1, 3, (count, 1), np.uint8)
        cells = np.stack([rng.permutation(2) + 1 for _ in range(3 * count)]).astype(np.uint8)
        actions = (cells == missions.repeat(3, axis=0)).argmax(axis=1).astype(np.uint8)
        ends = np.arange(0, 3 * count + 1, 3)
        episodes = Episodes(cells.reshape(-1, 1, 2, 1), actions, missions, ends, np.ones(count), np.arange(count))
        save_demonstrations(Demonstrations(episodes, "Pick-v0", {}), folder / "demos" / f"{split}.safetensors")
    return folder


@pytest.fixture(scope="module")
def guide(folder):
    clone("guide", PICK, [folder / "demos"], folder / "guide", 0, 1, False, config_file=folder / "bc.yml")
    return folder / "guide"


def test_an_expert(folder):
    train_expert(PICK, folder / "expert", 0, 1, False, folder / "ppo.yml")
    assert load_agent(folder / "expert").observation_space["image"].shape == (1, 2, 1)
    assert read_json(folder / "expert" / "agent.json")["level"] == "Pick-v0"
    poor = load_agent(folder / "expert")
    th.nn.init.constant_(poor.action_net.bias[:1], 100.0)  # goes left, whatever it sees
    save_agent(poor, folder / "poor", PICK)
    with pytest.raises(ValueError, match=r"the expert solved \d+ of 20 missions of Pick-v0: train it longer"):
        record_demonstrations(PICK, folder / "poor", "train", 20, folder / "train.safetensors", 1)


def test_a_guide_and_what_it_says(folder, guide):
    assert read_json(guide / "evaluation.json")["success_rate"] > 0.9
    analyze(guide, PICK, folder / "demos" / "validation.safetensors", None, guide / "analysis", 1, n_episodes=30)
    found = read_json(guide / "analysis" / "analysis.json")
    assert found["actions"] == ["left", "right"]
    assert np.array(found["counts"]).shape == (9, 2)
    assert found["along_demonstrations"]["uniform_cic"]["mean"] > 0.1
    assert "situations" not in found
    assert sorted(path.name for path in (guide / "analysis").iterdir()) == ["actions.png", "analysis.json"]
    ablate_agent(guide, PICK, 30, guide / "ablation.json", 1)
    rates = {name: row["success_rate"] for name, row in read_json(guide / "ablation.json")["interventions"].items()}
    assert rates["spoken"] > 0.9 > 0.5 > rates["silent"]


def test_speaking_to_it_in_words_for_its_own_actions(guide, capsys):
    speak_to(guide, None, ["left", "right", "right"], None, True, guide / "speech", 0, 1)
    found = read_json(guide / "speech" / "speech.json")
    assert found["walk"]["taken"] == ["left", "right", "right"] == found["walk"]["meant"]
    assert found["obedience"]["raw"] > 0.9
    assert "right" in capsys.readouterr().out
    with pytest.raises(ValueError, match="step 'forward' is unknown: expected one of left, right"):
        speak_to(guide, None, ["forward"], None, False, guide / "speech", 0, 1)


def test_a_guided_learner(folder, guide):
    clone(
        *("guided", PICK, [folder / "demos"], folder / "guided", 0, 1, False),
        guide=str(guide),
        params=["n_epochs:1", "validate_every:1"],
        config_file=folder / "bc.yml",
    )
    evaluate(folder / "guided", PICK, 10, folder / "evaluation.json", 1)
    assert read_json(folder / "evaluation.json")["level"] == "Pick-v0"


def test_environments_by_name_and_package():
    assert environment(PICK) == "Pick-v0"
    assert environment("GuideGrid-GoToObj-v0") == "GoToObj"
    assert split_levels(f"GoToObj+{PICK}+GoToObj") == ["GoToObj", "Pick-v0"]
    with pytest.raises(ValueError, match="the package 'no_such_package' can't be imported"):
        environment("no_such_package:Pick-v0")
    with pytest.raises(ValueError, match="unknown environment 'Pick-v9'"):
        environment("tests.toys:Pick-v9")


def test_what_draws_itself():
    makers = {"Drawn-v0": lambda render_mode=None: gymnasium.make(DOOR_KEY, render_mode=render_mode)}
    makers["Undrawn-v0"] = lambda: gymnasium.make(DOOR_KEY)
    with patch.dict(gymnasium.registry):
        for env_id, maker in makers.items():
            gymnasium.register(env_id, maker)
        env = drawn("Drawn-v0")
        env.reset()
        assert env.render().ndim == 3
        assert drawn("Undrawn-v0") is None
    assert drawn("Pick-v0") is None
