"""Minigrid's bot plays our levels."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from sb3_guide.envs import LEVELS, GuideGridEnv
from sb3_guide.envs.bot import play


@pytest.mark.parametrize("level", LEVELS)
def test_actions_of_the_bot_accomplish_our_missions(level: str) -> None:
    """The last step, and no other one, is a success."""
    env = GuideGridEnv(level, history=0)
    for seed in range(3):
        episode = play(level, seed)
        assert episode.success
        assert episode.failure is None
        env.reset(seed=seed)
        ends = [env.step(action)[2] for action in episode.actions]
        assert ends == [False] * (len(ends) - 1) + [True]


def test_failures_are_reported() -> None:
    """Here the key lies in the room that it opens, one of Minigrid's unsolvable missions."""
    episode = play("GuideGrid-GoToImpUnlock-v0", seed=6)
    assert not episode.success
    assert episode.failure == "RuntimeError: no plan after 1000 searches"


def test_the_same_seed_gives_the_same_actions() -> None:
    """The bot does not draw."""
    np.testing.assert_array_equal(play("GoTo", 5).actions, play("GoTo", 5).actions)


def test_unknown_level_is_refused() -> None:
    """The error names the level."""
    with pytest.raises(ValueError, match="GoToNowhere"):
        play("GoToNowhere", 0)


def test_without_minigrid_the_error_says_what_to_install() -> None:
    """Minigrid is an extra; the levels do not need it."""
    program = "import sys; sys.modules['minigrid'] = None; import sb3_guide.envs; import sb3_guide.envs.bot"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert "pip install 'sb3-guide[bot]'" in result.stderr
    assert "bot.py" in result.stderr
