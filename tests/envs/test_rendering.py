"""Frames are Minigrid's, pixel for pixel."""

from __future__ import annotations

import numpy as np
import pytest

from sb3_guide.envs import GuideGridEnv, GuideGridVecEnv
from sb3_guide.envs.bot import twin
from tests.envs.oracle import mixed_actions


@pytest.mark.parametrize("level", ["GoToLocal", "BossLevel"])
def test_frames_are_minigrids(level: str) -> None:
    """All kinds of objects and doors, the agent in all directions, its view highlighted."""
    theirs, ours = twin(level, render_mode="rgb_array"), GuideGridEnv(level, render_mode="rgb_array")
    theirs.reset(seed=4)
    ours.reset(seed=4)
    for action in mixed_actions(np.random.default_rng(0), 60):
        np.testing.assert_array_equal(ours.render(), theirs.render())
        if any(theirs.step(action)[2:4]) | any(ours.step(action)[2:4]):
            theirs.reset()
            ours.reset()


def test_vec_env_tiles_its_worlds() -> None:
    """SB3's `render` makes one picture of all frames."""
    env = GuideGridVecEnv("GoToObj", 4, seed=0, render_mode="rgb_array")
    env.reset()
    frames = env.get_images()
    assert [frame.shape for frame in frames] == [(256, 256, 3)] * 4
    tiled = env.render()
    assert tiled is not None
    np.testing.assert_array_equal(tiled[256:, :256], frames[2])
