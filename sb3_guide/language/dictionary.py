"""Which action goes with which message: enough to speak (paper sections 5.1 and 5.4)."""

from dataclasses import dataclass

import numpy as np

from sb3_guide.envs import ACTIONS
from sb3_guide.language.reading import Reading
from sb3_guide.metrics import conditional, joint_counts
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


def learn(reading: Reading) -> Dictionary:
    """:return: the dictionary of what was read"""
    counts = joint_counts(reading.messages, reading.episodes.actions, reading.shape.count, len(reading.actions))
    return Dictionary(reading.shape, counts, reading.actions)
