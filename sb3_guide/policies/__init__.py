"""Policies of Learner, Guide and guided Learner, under their names in SB3's and sb3-contrib's algorithms."""

from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, PPO

from sb3_guide.policies.base import AgentPolicy
from sb3_guide.policies.channel import MessageShape
from sb3_guide.policies.film import FiLMExtractor
from sb3_guide.policies.pretrained import PretrainedGuide
from sb3_guide.policies.recurrent import RecurrentGuidedLearnerPolicy, RecurrentGuidePolicy, RecurrentLearnerPolicy
from sb3_guide.policies.saving import load_agent, save_agent
from sb3_guide.policies.window import GuidedLearnerPolicy, GuidePolicy, LearnerPolicy

for algorithm in (PPO, A2C):
    algorithm.policy_aliases.update(
        LearnerPolicy=LearnerPolicy, GuidePolicy=GuidePolicy, GuidedLearnerPolicy=GuidedLearnerPolicy
    )
RecurrentPPO.policy_aliases.update(
    LearnerPolicy=RecurrentLearnerPolicy, GuidePolicy=RecurrentGuidePolicy, GuidedLearnerPolicy=RecurrentGuidedLearnerPolicy
)

__all__ = [
    "AgentPolicy",
    "FiLMExtractor",
    "GuidePolicy",
    "GuidedLearnerPolicy",
    "LearnerPolicy",
    "MessageShape",
    "PretrainedGuide",
    "RecurrentGuidePolicy",
    "RecurrentGuidedLearnerPolicy",
    "RecurrentLearnerPolicy",
    "load_agent",
    "save_agent",
]
