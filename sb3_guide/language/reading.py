"""What an agent with a channel said along the episodes that it played, and what it would have done, had it heard otherwise."""

from dataclasses import dataclass

import numpy as np
import torch as th

from sb3_guide.cloning.episodes import Episodes, play
from sb3_guide.envs import ACTIONS, action_names
from sb3_guide.policies import AgentPolicy
from sb3_guide.policies.channel import MessageShape
from sb3_guide.policies.sequences import history_of


@dataclass(frozen=True)
class Reading:
    """
    F frames of E episodes, M messages, A actions.

    :param shape: form of the messages
    :param episodes: that were played, by the agent or by somebody else
    :param messages: (F,) int64 index of the most probable message at each frame
    :param message_log_probs: (F, M) log-probability of each message
    :param action_log_probs: (F, M, A) log-probability of each action, were each message heard
    :param actions: names of the actions
    """

    shape: MessageShape
    episodes: Episodes
    messages: np.ndarray
    message_log_probs: th.Tensor
    action_log_probs: th.Tensor
    actions: tuple[str, ...] = ACTIONS

    @property
    def episode(self) -> np.ndarray:
        """(F,) int64, which episode each frame belongs to."""
        return np.repeat(np.arange(len(self.episodes)), self.episodes.lengths)


def read(policy: AgentPolicy, level: str, seeds: np.ndarray) -> Reading:
    """
    Let an agent play, with the most probable messages and actions, and read along.

    :param policy: with a channel
    :param level: name or id of the level, or id of another environment
    :param seeds: (E,) of the missions
    :raises ValueError: if the policy has no channel, or a continuous one or one of too many messages, there are no seeds, or
        the level is not the policy's
    """
    policy.channel.encoder.shape.check_enumerable()
    return read_along(policy, level, play(policy, level, seeds))


def read_along(policy: AgentPolicy, level: str, episodes: Episodes) -> Reading:
    """
    Read what an agent would say along episodes that somebody played, such as an expert.

    :param policy: with a channel
    :param level: name or id of the level, or id of another environment, where it was
    :param episodes: at least one
    :raises ValueError: if the policy has no channel, or a continuous one
    """
    shape = policy.channel.encoder.shape
    memory = memory_of(policy, episodes)
    parts = memory.split(shape.frames_at_once)
    with th.no_grad():
        messages = th.cat([policy.channel.message_log_probs(part) for part in parts])
        actions = th.cat([policy.listen(part) for part in parts])
    return Reading(shape, episodes, said(policy, memory), messages.cpu(), actions.cpu(), action_names(level))


def said(policy: AgentPolicy, memory: th.Tensor) -> np.ndarray:
    """
    :param policy: with a channel
    :param memory: (F, state_size) of the agent, see :func:`memory_of`
    :return: (F,) int64 index of the most probable message at each frame
    :raises ValueError: if the policy has no channel, or a continuous one
    """
    shape = policy.channel.encoder.shape
    with th.no_grad():
        spoken = [policy.channel.speak(part).argmax(dim=-1) for part in memory.split(shape.frames_at_once)]
    return shape.index(th.cat(spoken)).cpu().numpy()


def memory_of(policy: AgentPolicy, episodes: Episodes) -> th.Tensor:
    """:return: (F, state_size) what the agent remembers at every frame of the episodes"""
    with th.no_grad():
        if policy.carries_memory:
            return policy.network.remember(episodes.sequences().to(policy.device))
        return policy.network.recall(episodes.windows(history_of(policy.observation_space)).to(policy.device))
