"""The page that takes a newcomer's environment through all stages does what it says."""

import re
from pathlib import Path

import gymnasium
import numpy as np
import pytest

PAGE = Path(__file__).parent.parent / "docs" / "your-environment.md"


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """What the page's code leaves behind."""
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("newcomer"))
        for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL):
            exec(compile(block, PAGE.name, "exec"), found)
    yield found
    for env_id in ("MyPick-v0", "MyDoorKey-v0"):
        del gymnasium.registry[env_id]


def test_the_toy_is_learned_and_talked_about(names):
    assert names["play"](names["expert"].policy, "MyPick-v0", names["mission_seeds"]("analysis", 100)).successes.mean() > 0.9
    assert names["of_guide"]["success_rate"] > 0.9
    assert names["of_guided"]["success_rate"] > 0.9
    meant, taken = names["meant"], names["taken"]
    assert len(np.unique(meant)) == 2  # there is a word for each action
    assert names["obedience"](meant, taken)[0] > 0.8


def test_a_text_mission_is_learned_from(names):
    assert names["model"].num_timesteps == 128
    assert names["model"].observation_space["mission"].shape == (13,)
