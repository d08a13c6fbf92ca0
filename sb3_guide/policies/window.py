"""Policies with window memory: stateless, so that PPO, A2C and all else that knows no hidden state can use them."""

import torch as th

from sb3_guide.policies.agents import GuideAgent, GuidedLearnerAgent, LearnerAgent
from sb3_guide.policies.base import AgentPolicy
from sb3_guide.policies.memory import State
from sb3_guide.policies.sequences import Observations, windows


class WindowMemory(AgentPolicy):
    """The memory runs over the observation's window, from nothing, at every call."""

    carries_memory = False

    def memory(self, obs: Observations, state: State | None = None) -> th.Tensor:
        return self.network.recall(windows(obs))


class LearnerPolicy(LearnerAgent, WindowMemory):
    """Learner for PPO and A2C."""


class GuidePolicy(GuideAgent, WindowMemory):
    """Guide for PPO and A2C."""


class GuidedLearnerPolicy(GuidedLearnerAgent, WindowMemory):
    """Learner with a Guide for PPO and A2C."""
