"""Seed for seed, the levels are Minigrid's."""

from __future__ import annotations

import numpy as np
import pytest
from minigrid.utils.baby_ai_bot import BabyAIBot

from sb3_guide.envs import LEVELS, GuideGridEnv
from tests.envs.oracle import Twins, first_difference


@pytest.mark.parametrize("level", LEVELS)
def test_levels_are_minigrids(level: str) -> None:
    """Image, direction, mission, reward, ends and generator agree, through seeded and unseeded resets."""
    for seed, steps in ((0, 1000), (1, 500), (2, 200), (123456789, 200)):
        assert first_difference(level, seed, steps) is None


@pytest.mark.parametrize("level", LEVELS)
def test_many_first_missions_are_minigrids(level: str) -> None:
    """One step suffices to compare what a seed draws."""
    assert [first_difference(level, seed, steps=1) for seed in range(1000, 1100)] == [None] * 100


@pytest.mark.parametrize("level", [level for level in LEVELS if level != "GoToImpUnlock"])  # its missions may be unsolvable
def test_missions_are_accomplished_alike(level: str) -> None:
    """Minigrid's bot solves them, so that every kind of mission is seen to its end."""
    for seed in range(5):
        twins = Twins(level)
        assert twins.reset(seed=seed) is None
        bot, action, over, success = BabyAIBot(twins.theirs), None, False, False
        while not over:
            action = bot.replan(action)
            difference, success, over = twins.step(int(action))
            assert difference is None
        assert success


def test_success_on_the_last_step_terminates_and_truncates() -> None:
    """Minigrid does both, and pays what is left of the reward."""
    env = GuideGridEnv("GoToObj", history=0)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    outcome: list = [0.0, False, False]
    while not outcome[1]:
        before, action = env.get_state(), rng.integers(3)
        _, *outcome, _ = env.step(action)
    before["steps"][:] = 63
    env.set_state(before)
    _, *outcome, info = env.step(action)
    assert outcome == [1 - 0.9, True, True]
    assert info == {"is_success": True}
