"""Policies with window memory: stateless, so that PPO, A2C and all else that knows no hidden state can use them."""

from typing import Any

import torch as th
from stable_baselines3.common.distributions import Distribution

from sb3_guide.policies.agents import GuideAgent, GuidedLearnerAgent, LearnerAgent
from sb3_guide.policies.base import AgentPolicy
from sb3_guide.policies.memory import State
from sb3_guide.policies.networks import Latent
from sb3_guide.policies.sequences import Observations, windows


class WindowMemory(AgentPolicy):
    """The memory runs over the observation's window, from nothing, at every call."""

    carries_memory = False

    def extract_features(self, obs: Observations, features_extractor: Any = None) -> Latent:  # type: ignore[override]
        return self.network(obs)  # which takes observations as they are: SB3 would make floats of all of them first

    def memory(self, obs: Observations, state: State | None = None) -> th.Tensor:
        return self.network.look_back(windows(obs))

    def forward(  # type: ignore[override]
        self, obs: Observations, deterministic: bool = False
    ) -> tuple[th.Tensor, th.Tensor, th.Tensor]:
        distribution, values = self._explore(obs)
        actions = distribution.get_actions(deterministic=deterministic)
        return actions, values, distribution.log_prob(actions)

    def evaluate_actions(  # type: ignore[override]
        self, obs: Observations, actions: th.Tensor
    ) -> tuple[th.Tensor, th.Tensor, th.Tensor | None]:
        distribution, values = self._explore(obs)
        return values, distribution.log_prob(actions), distribution.entropy()

    def _explore(self, obs: Observations) -> tuple[Distribution, th.Tensor]:
        """:return: distribution of actions in training, and values"""
        latent = self.network(obs)
        values = self.value_net(self.mlp_extractor.forward_critic(latent))  # type: ignore[arg-type]
        return self.exploring_distribution(latent), values


class LearnerPolicy(LearnerAgent, WindowMemory):
    """Learner for PPO and A2C."""


class GuidePolicy(GuideAgent, WindowMemory):
    """Guide for PPO and A2C."""


class GuidedLearnerPolicy(GuidedLearnerAgent, WindowMemory):
    """Learner with a Guide for PPO and A2C."""
