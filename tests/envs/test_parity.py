"""Seed for seed, the levels are Minigrid's."""

from __future__ import annotations

import numpy as np
import pytest

from sb3_guide.envs import LEVELS, GuideGridEnv
from tests.envs.oracle import mixed_actions, oracle, stream

SEEDS = (0, 1, 2, 17, 123456789)
STEPS = 700


@pytest.mark.parametrize("level", LEVELS)
def test_levels_are_minigrids(level: str) -> None:
    """Image, mission, reward, ends and generator agree, through seeded and unseeded resets."""
    theirs, ours = oracle(level), GuideGridEnv(level, history=0)
    for seed in SEEDS:
        (expected, _), (observation, _) = theirs.reset(seed=seed), ours.reset(seed=seed)
        for action in mixed_actions(np.random.default_rng(seed), STEPS):
            np.testing.assert_array_equal(observation["image"], expected["image"])
            assert ours.mission == theirs.unwrapped.mission
            assert stream(ours) == stream(theirs)
            expected, *outcome, _ = theirs.step(action)
            observation, *own_outcome, _ = ours.step(action)
            assert own_outcome == outcome  # reward, terminated, truncated
            if any(outcome[1:]):
                np.testing.assert_array_equal(observation["image"], expected["image"])
                (expected, _), (observation, _) = theirs.reset(), ours.reset()


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
