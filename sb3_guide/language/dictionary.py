"""Which action goes with which message: enough to speak (paper sections 5.1 and 5.4)."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from sb3_guide.cloning.episodes import play
from sb3_guide.envs import ACTIONS, action_names
from sb3_guide.files import read_json, write_json
from sb3_guide.language.reading import Reading, memory_of, said
from sb3_guide.metrics import conditional, joint_counts
from sb3_guide.policies import AgentPolicy
from sb3_guide.policies.channel import MessageShape

STRONG = 0.8  # P(action|message) from which on a message means its action
OFTEN = 20  # frames that it takes to know


@dataclass(frozen=True)
class Dictionary:
    """
    M messages, A actions.

    :param shape: form of the messages
    :param counts: (M, A) int64, how often each action followed each message
    :param actions: names of the actions
    """

    shape: MessageShape
    counts: np.ndarray
    actions: tuple[str, ...] = ACTIONS

    @property
    def probabilities(self) -> np.ndarray:
        """(M, A) P(action|message); NaN where a message never occurred."""
        return conditional(self.counts)

    @property
    def meanings(self) -> np.ndarray:
        """(M,) int64, the action that strongly follows each message; -1 where none does, or it is too rare to know."""
        strength = self.counts.max(axis=1) / self.counts.sum(axis=1).clip(min=1)
        known = (strength >= STRONG) & (self.counts.sum(axis=1) >= OFTEN)
        return np.where(known, self.counts.argmax(axis=1), -1)

    def message_for(self, action: int) -> int:
        """
        :param action: index of the action
        :return: index of the message that means it, of several the most used one
        :raises ValueError: if no message does
        """
        meanings = self.meanings
        if action not in meanings:
            known = ", ".join(self.actions[meant] for meant in np.unique(meanings[meanings >= 0])) or "none"
            raise ValueError(f"the agent has no word for {self.actions[action]!r}: its messages mean {known}")
        return int(np.argmax(np.where(meanings == action, self.counts.sum(axis=1), -1)))

    def word(self, action: str) -> str:
        """
        :param action: its name, such as "left"
        :return: the message that means it, such as "w0 w2"
        :raises ValueError: if there is no such action, or no message means it
        """
        if action not in self.actions:
            raise ValueError(f"{action!r} is no action: expected one of {', '.join(self.actions)}")
        return self.shape.names()[self.message_for(self.actions.index(action))]


def save_dictionary(dictionary: Dictionary, path: Path) -> None:
    """
    Write a dictionary as JSON: for each message that occurs, how often each action followed.

    :param dictionary: what
    :param path: where; its folder exists
    """
    actions = dictionary.actions
    followed = {
        message: {actions[action]: int(counts[action]) for action in np.flatnonzero(counts)}
        for message, counts in zip(dictionary.shape.names(), dictionary.counts, strict=True)
        if counts.any()
    }
    write_json(path, {"shape": asdict(dictionary.shape), "actions": list(actions), "followed": followed})


def read_dictionary(path: Path) -> Dictionary:
    """
    :param path: of a file that :func:`save_dictionary` wrote
    :raises ValueError: if it is damaged
    """
    content = read_json(path)
    try:
        shape, actions = MessageShape(**content["shape"]), tuple(content["actions"])
        counts = np.zeros((shape.count, len(actions)), dtype=np.int64)
        rows = {name: row for row, name in enumerate(shape.names())}
        for message, followed in content["followed"].items():
            for action, times in followed.items():
                counts[rows[message], actions.index(action)] = times
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"{path} is no dictionary: {error}") from error
    return Dictionary(shape, counts, actions)


def learn(reading: Reading) -> Dictionary:
    """:return: the dictionary of what was read"""
    counts = joint_counts(reading.messages, reading.episodes.actions, reading.shape.count, len(reading.actions))
    return Dictionary(reading.shape, counts, reading.actions)


def overhear(policy: AgentPolicy, level: str, seeds: np.ndarray) -> Dictionary:
    """
    The dictionary of what an agent says while it plays: that of :func:`learn`, without asking what it could have said instead.

    :param policy: with a channel
    :param level: name or id of the level, or id of another environment
    :param seeds: (E,) of the missions
    :raises ValueError: if the policy has no channel, or a continuous one or one of too many messages, there are no seeds, or
        the level is not the policy's
    """
    shape, actions = policy.channel.encoder.shape, action_names(level)
    shape.check_enumerable()
    episodes = play(policy, level, seeds)
    messages = said(policy, memory_of(policy, episodes))
    return Dictionary(shape, joint_counts(messages, episodes.actions, shape.count, len(actions)), actions)
