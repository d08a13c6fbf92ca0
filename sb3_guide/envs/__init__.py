"""
BabyAI's levels on a compiled engine that is seed-for-seed Minigrid, for Gymnasium and for Stable-Baselines3; and what brings
other environments into their form.

Importing this package registers every level as `GuideGrid-<Level>-v0`.
"""

import gymnasium
from gymnasium import vector

from sb3_guide.envs import arrays as _arrays  # noqa: F401  # teaches SB3 to say what is wrong with missions as text
from sb3_guide.envs.env import GuideGridEnv
from sb3_guide.envs.levels import LEVELS, Level, level_of
from sb3_guide.envs.spaces import ACTIONS, DEFAULT_HISTORY, observation_space
from sb3_guide.envs.vec_env import GuideGridVecEnv
from sb3_guide.envs.vocabulary import MISSION_LENGTH, VOCABULARY_SIZE, WORDS, Vocabulary, decode, encode
from sb3_guide.envs.worlds import Worlds, action_names, is_level, name_of, spaces_of, worlds_of
from sb3_guide.envs.wrappers import HistoryWrapper, TextMissionWrapper

__all__ = [
    "ACTIONS",
    "DEFAULT_HISTORY",
    "LEVELS",
    "MISSION_LENGTH",
    "VOCABULARY_SIZE",
    "WORDS",
    "GuideGridEnv",
    "GuideGridVecEnv",
    "HistoryWrapper",
    "Level",
    "TextMissionWrapper",
    "Vocabulary",
    "Worlds",
    "action_names",
    "decode",
    "encode",
    "is_level",
    "level_of",
    "name_of",
    "observation_space",
    "spaces_of",
    "worlds_of",
]

# Since 1.1, Gymnasium lets a vector env say when it begins new episodes; without that, `make_vec` has to use single envs.
_vector_env = "sb3_guide.envs.vector_env:GuideGridVectorEnv" if hasattr(vector, "AutoresetMode") else None

for _level in LEVELS.values():
    if _level.env_id not in gymnasium.registry:
        gymnasium.register(
            _level.env_id,
            entry_point="sb3_guide.envs.env:GuideGridEnv",
            vector_entry_point=_vector_env,
            kwargs={"level": _level.name},
            disable_env_checker=True,  # its warnings, about the images' shape, are expected
        )
