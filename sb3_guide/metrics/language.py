"""What messages go together with, from counts: correlations, where :mod:`sb3_guide.metrics.communication` asks for causes."""

import numpy as np


def message_action_counts(messages: np.ndarray, actions: np.ndarray, n_messages: int, n_actions: int) -> np.ndarray:
    """
    How often each action followed each message (paper section 5.1).

    :param messages: (N,) index of the message at each frame
    :param actions: (N,) the action taken at each frame
    :param n_messages: M
    :param n_actions: A
    :return: (M, A) int64
    :raises ValueError: if the two differ in shape or hold an index out of range
    """
    if messages.shape != actions.shape or messages.ndim != 1:
        raise ValueError(f"messages {messages.shape} and actions {actions.shape} differ: expected one of each a frame")
    for name, values, count in (("messages", messages, n_messages), ("actions", actions, n_actions)):
        if values.size and (values.min() < 0 or values.max() >= count):
            raise ValueError(f"{name} range from {values.min()} to {values.max()}: expected 0 to {count - 1}")
    return np.bincount(messages.astype(np.int64) * n_actions + actions, minlength=n_messages * n_actions).reshape(
        n_messages, n_actions
    )


def conditional(counts: np.ndarray) -> np.ndarray:
    """
    P(column|row) from counts.

    :param counts: (R, C)
    :return: (R, C) float64; NaN in rows that never occurred
    """
    with np.errstate(invalid="ignore"):
        return counts / counts.sum(axis=1, keepdims=True)
