"""Policies with window memory: stateless, so that PPO, A2C and all else that knows no hidden state can use them."""

import torch as th
from stable_baselines3.common.distributions import Distribution

from sb3_guide.policies.agents import GuideAgent, GuidedLearnerAgent, LearnerAgent
from sb3_guide.policies.base import AgentPolicy
from sb3_guide.policies.memory import State
from sb3_guide.policies.sequences import Observations, windows


class WindowMemory(AgentPolicy):
    """
    The memory runs over the observation's window, from nothing, at every call. Networks take observations as they are, bytes
    for the most part; SB3's own methods would make floats of them first.
    """

    carries_memory = False

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

    def get_distribution(self, obs: Observations) -> Distribution:  # type: ignore[override]
        return self.action_distribution(self.network(obs))

    def predict_values(self, obs: Observations) -> th.Tensor:  # type: ignore[override]
        return self.value_net(self.mlp_extractor.forward_critic(self.network(obs)))  # type: ignore[arg-type]

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
