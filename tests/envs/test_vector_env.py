"""Gymnasium's `make_vec` makes native vector envs of the levels, where Gymnasium is new enough to define what they do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import vector

from sb3_guide.envs import DEFAULT_HISTORY, LEVELS, observation_space
from tests.envs.oracle import mixed_actions

pytestmark = pytest.mark.skipif(not hasattr(vector, "AutoresetMode"), reason="Gymnasium before 1.1")
LEVEL = "GuideGrid-GoToLocal-v0"


def assert_same(a: Any, b: Any) -> None:
    """Check that nested tuples, mappings and arrays are equal; None marks a world without a value."""
    if isinstance(a, Mapping):
        assert set(a) == set(b)
        for name in a:
            assert_same(a[name], b[name])
    elif a is None:
        assert b is None
    elif isinstance(a, tuple) or np.asarray(a).dtype.hasobject:
        for one, other in zip(a, b, strict=True):
            assert_same(one, other)
    else:
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("history", [0, 2])
def test_equals_gymnasiums_own(history: int) -> None:
    """Observations, rewards, ends and infos are those of single envs in a SyncVectorEnv that resets in the same step."""
    mode = vector.AutoresetMode.SAME_STEP
    ours = gymnasium.make_vec(LEVEL, num_envs=5, history=history)
    sync = gymnasium.make_vec(
        LEVEL, num_envs=5, history=history, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}
    )
    assert ours.metadata["autoreset_mode"] is sync.metadata["autoreset_mode"] is mode
    assert (ours.observation_space, ours.action_space) == (sync.observation_space, sync.action_space)
    assert (ours.single_observation_space, ours.single_action_space) == (observation_space(history), sync.single_action_space)
    assert_same(ours.reset(seed=3), sync.reset(seed=3))
    for actions in mixed_actions(np.random.default_rng(0), 1000).reshape(200, 5):
        assert_same(ours.step(actions), sync.step(actions))
    assert_same(ours.reset(seed=[1, None, 3, None, 5]), sync.reset(seed=[1, None, 3, None, 5]))


@pytest.mark.parametrize("level", LEVELS)
def test_every_level_has_one(level: str) -> None:
    """With the default history."""
    env = gymnasium.make_vec(f"GuideGrid-{level}-v0", num_envs=2)
    assert env.single_observation_space == observation_space(DEFAULT_HISTORY)
    assert env.reset(seed=0)[0] in env.observation_space


def test_frames() -> None:
    """One of every world; none without a render mode."""
    env = gymnasium.make_vec(LEVEL, num_envs=2, render_mode="rgb_array")
    env.reset(seed=0)
    assert [frame.shape for frame in env.render()] == [(256, 256, 3)] * 2
    assert gymnasium.make_vec(LEVEL, num_envs=2).render() is None


def test_episode_statistics_of_gymnasium() -> None:
    """Gymnasium's wrapper counts whole episodes."""
    env = gymnasium.wrappers.vector.RecordEpisodeStatistics(gymnasium.make_vec(LEVEL, num_envs=2))
    env.reset(seed=0)
    lengths = []
    for actions in mixed_actions(np.random.default_rng(0), 400).reshape(200, 2):
        infos = env.step(actions)[4]
        lengths += infos["episode"]["l"][infos["_episode"]].tolist() if "episode" in infos else []
    assert sum(lengths) <= 400
    assert max(lengths) == 64


@pytest.mark.parametrize("seed", [-1, [0], [0, -1], 2**64, 1.5])
def test_wrong_seeds_are_refused(seed: Any) -> None:
    """One non-negative integer for every world."""
    with pytest.raises(ValueError, match="seeds="):
        gymnasium.make_vec(LEVEL, num_envs=2).reset(seed=seed)


def test_wrong_use_is_refused() -> None:
    """Some of the worlds, a window, a step before the first reset."""
    env = gymnasium.make_vec(LEVEL, num_envs=2)
    with pytest.raises(ValueError, match="reset_mask"):
        env.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(ValueError, match="before the first reset"):
        env.step(np.zeros(2, dtype=int))
    with pytest.raises(ValueError, match="human"):
        gymnasium.make_vec(LEVEL, num_envs=2, render_mode="human")
