"""What the agent observes and does, the same for every level."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from sb3_guide.envs.vocabulary import MISSION_LENGTH, VOCABULARY_SIZE

#: names of Minigrid's seven actions, in the order of their numbers
ACTIONS = ("left", "right", "forward", "pickup", "drop", "toggle", "done")
IMAGE_SHAPE = (7, 7, 3)
DEFAULT_HISTORY = 3  #: images before the present one in an observation
MAX_HISTORY = 1000
_IMAGE_HIGH = 10  # the highest number of Minigrid's encoding; with 255, SB3 would take the image for a picture


def observation_space(history: int) -> spaces.Dict:
    """
    :param history: how many images before the present one an observation holds
    :return: "image" (7, 7, 3), "mission" (72,) and, if history > 0, "history" (history, 7, 7, 3), all uint8
    :raises ValueError: if history is out of range
    """
    if not isinstance(history, int | np.integer) or not 0 <= history <= MAX_HISTORY:
        raise ValueError(f"history={history}: expected 0 to {MAX_HISTORY} images")
    members: dict[str, spaces.Space] = {
        "image": spaces.Box(0, _IMAGE_HIGH, IMAGE_SHAPE, np.uint8),
        "mission": spaces.Box(0, VOCABULARY_SIZE - 1, (MISSION_LENGTH,), np.uint8),
    }
    if history:
        members["history"] = spaces.Box(0, _IMAGE_HIGH, (history, *IMAGE_SHAPE), np.uint8)
    return spaces.Dict(members)


def action_space() -> spaces.Discrete:
    """:return: Minigrid's seven actions, in the order of `ACTIONS`"""
    return spaces.Discrete(len(ACTIONS))
