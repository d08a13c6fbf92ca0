"""
Agents that guide each other by emergent language, as an extension of Stable-Baselines3.

Importing this package registers the levels in Gymnasium and the policies' names in PPO, A2C and RecurrentPPO.
"""

from importlib.metadata import version

from sb3_guide.envs import GuideGridVecEnv
from sb3_guide.experts import load_expert
from sb3_guide.language import speak
from sb3_guide.policies import PretrainedGuide, load_agent, save_agent
from sb3_guide.speakers import load_dictionary, load_guide, load_guided_learner

__version__ = version("sb3-guide")
__all__ = [
    "GuideGridVecEnv",
    "PretrainedGuide",
    "load_agent",
    "load_dictionary",
    "load_expert",
    "load_guide",
    "load_guided_learner",
    "save_agent",
    "speak",
]
