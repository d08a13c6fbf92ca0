"""Policies that carry their memory through the episode, as in the paper: for RecurrentPPO and for cloning."""

from typing import Any

import torch as th
from gymnasium import spaces
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.type_aliases import Schedule
from torch import nn

from sb3_guide.policies.agents import GuideAgent, GuidedLearnerAgent, LearnerAgent
from sb3_guide.policies.base import AgentPolicy, check_left_out
from sb3_guide.policies.interventions import Scene
from sb3_guide.policies.memory import State, scene_of
from sb3_guide.policies.networks import Latent
from sb3_guide.policies.sequences import Observations, frames, padded, unpadded

LSTM = {"lstm_hidden_size", "n_lstm_layers", "shared_lstm", "enable_critic_lstm", "lstm_kwargs"}


class StateShape(nn.Module):
    """
    Stands where RecurrentPPO looks for an LSTM to learn the shape of its state.

    :param hidden_size: width of h and of c
    """

    num_layers = 1

    def __init__(self, hidden_size: int) -> None:
        super().__init__()
        self.hidden_size = hidden_size


class CarriedMemory(AgentPolicy, RecurrentActorCriticPolicy):
    """The memory goes on from step to step; actor and critic share it, so both halves of ``RNNStates`` are the same."""

    carries_memory = True

    def __init__(
        self, observation_space: spaces.Dict, action_space: spaces.Discrete, lr_schedule: Schedule, **kwargs: Any
    ) -> None:
        check_left_out(kwargs, LSTM)
        # RecurrentActorCriticPolicy builds an LSTM of its own: the smallest there is, to be replaced at once
        kwargs = {**kwargs, "lstm_hidden_size": 1, "shared_lstm": True, "enable_critic_lstm": False}
        super().__init__(observation_space, action_space, lr_schedule, **kwargs)
        self.lstm_actor = StateShape(self.network.state_size)  # type: ignore[assignment]
        self.lstm_hidden_state_shape = (1, 1, self.network.state_size)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)  # type: ignore[call-arg]

    def memory(self, obs: Observations, state: State | None = None) -> th.Tensor:
        return self.network.remember(frames(obs), state)

    def _step(self, obs: Observations, state: State, episode_starts: th.Tensor) -> tuple[Latent, State]:
        """
        :param obs: of B worlds
        :param state: (h, c), (1, B, state_size) each, before it
        :param episode_starts: (B,) 1 where an episode begins
        :return: latent, and the state after it
        """
        before = started_anew(state, episode_starts)
        memory, state = self.network.step(frames(obs), before)
        scene = Scene(th.arange(len(memory), device=memory.device), lambda: before[0].squeeze(0))
        return self.network.latent(memory, scene), state

    def _carry(self, obs: Observations, state: State, episode_starts: th.Tensor) -> tuple[Latent, th.Tensor]:
        """
        :param obs: of n_seq sequences of T steps each, flattened; zeros where RecurrentPPO padded
        :param state: (h, c) before each sequence, (1, n_seq, state_size) each
        :param episode_starts: (n_seq * T,); episodes begin at the first step of a sequence or before it, never inside
        :return: latent of the K frames that are no padding, and (n_seq * T,) bool, which they are
        """
        n_seq = state[0].shape[1]
        sequences, valid = unpadded(obs, n_seq)
        before = started_anew(state, episode_starts.view(n_seq, -1)[:, 0])
        memory = self.network.remember(sequences, before)
        return self.network.latent(memory, scene_of(memory, sequences.lengths, before[0].squeeze(0))), valid.flatten()

    def forward(  # type: ignore[override]
        self, obs: Observations, lstm_states: RNNStates, episode_starts: th.Tensor, deterministic: bool = False
    ) -> tuple[th.Tensor, th.Tensor, th.Tensor, RNNStates]:
        latent, state = self._step(obs, lstm_states.pi, episode_starts)
        distribution = self.exploring_distribution(latent)
        actions = distribution.get_actions(deterministic=deterministic)
        values = self.value_net(self.mlp_extractor.forward_critic(latent))  # type: ignore[arg-type]
        return actions, values, distribution.log_prob(actions), RNNStates(state, state)

    def get_distribution(  # type: ignore[override]
        self, obs: Observations, lstm_states: State, episode_starts: th.Tensor
    ) -> tuple[Distribution, State]:
        latent, state = self._step(obs, lstm_states, episode_starts)
        return self.action_distribution(latent), state

    def predict_values(  # type: ignore[override]
        self, obs: Observations, lstm_states: State, episode_starts: th.Tensor
    ) -> th.Tensor:
        latent, _ = self._step(obs, lstm_states, episode_starts)
        return self.value_net(self.mlp_extractor.forward_critic(latent))  # type: ignore[arg-type]

    def evaluate_actions(  # type: ignore[override]
        self, obs: Observations, actions: th.Tensor, lstm_states: RNNStates, episode_starts: th.Tensor
    ) -> tuple[th.Tensor, th.Tensor, th.Tensor | None]:
        latent, valid = self._carry(obs, lstm_states.pi, episode_starts)
        distribution = self.exploring_distribution(latent)
        values = self.value_net(self.mlp_extractor.forward_critic(latent))  # type: ignore[arg-type]
        entropy = distribution.entropy()
        assert entropy is not None
        return padded(values, valid), padded(distribution.log_prob(actions[valid]), valid), padded(entropy, valid)


def started_anew(state: State, episode_starts: th.Tensor) -> State:
    """
    :param state: (h, c), (1, B, state_size) each
    :param episode_starts: (B,) 1 where an episode begins
    :return: the state, zero where an episode begins
    """
    goes_on = (1.0 - episode_starts).view(1, -1, 1)
    return state[0] * goes_on, state[1] * goes_on


class RecurrentLearnerPolicy(LearnerAgent, CarriedMemory):
    """Learner for RecurrentPPO and for cloning."""


class RecurrentGuidePolicy(GuideAgent, CarriedMemory):
    """Guide for RecurrentPPO and for cloning."""


class RecurrentGuidedLearnerPolicy(GuidedLearnerAgent, CarriedMemory):
    """Learner with a Guide for RecurrentPPO and for cloning."""
