"""
SB3 makes arrays for observations before it asks a policy whether it can see them, and stumbles over those that have no shape,
such as missions as text. Here it learns to say so.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

from gymnasium import spaces
from stable_baselines3.common.vec_env import dummy_vec_env


def explained(make: Callable[[spaces.Space], Any]) -> Callable[[spaces.Space], Any]:
    """
    :param make: SB3's function that derives arrays from an observation space
    :return: the same, which refuses what has no shape and says what to do about it
    """

    @wraps(make)
    def obs_space_info(obs_space: spaces.Space) -> Any:
        for name, space in obs_space.spaces.items() if isinstance(obs_space, spaces.Dict) else ():
            if space.shape is None:
                raise ValueError(
                    f"{name!r} of the observations is {space}, which SB3 can't hold in an array: make tokens of a text by "
                    "sb3_guide.envs.TextMissionWrapper, which leaves out all but image and mission, or leave it out yourself"
                )
        return make(obs_space)

    return obs_space_info


dummy_vec_env.obs_space_info = explained(dummy_vec_env.obs_space_info)  # type: ignore[assignment]  # the same but for the error
