"""Counts of what goes together."""

import numpy as np
import pytest

from sb3_guide.metrics import conditional, message_action_counts


def test_counts_and_conditional_distribution():
    counts = message_action_counts(np.array([0, 0, 0, 2]), np.array([1, 1, 0, 2]), n_messages=3, n_actions=3)
    assert counts.tolist() == [[1, 2, 0], [0, 0, 0], [0, 0, 1]]
    distribution = conditional(counts)
    assert distribution[0].tolist() == pytest.approx([1 / 3, 2 / 3, 0])
    assert np.isnan(distribution[1]).all()
    assert distribution[2].tolist() == [0, 0, 1]


def test_no_frames_make_no_counts():
    none = np.zeros(0, dtype=np.int64)
    assert message_action_counts(none, none, n_messages=2, n_actions=2).tolist() == [[0, 0], [0, 0]]


def test_frames_must_match():
    with pytest.raises(ValueError, match=r"messages \(2,\) and actions \(3,\) differ"):
        message_action_counts(np.zeros(2, int), np.zeros(3, int), 2, 2)


def test_indices_out_of_range_are_named():
    with pytest.raises(ValueError, match="actions range from 0 to 7: expected 0 to 6"):
        message_action_counts(np.array([0, 1]), np.array([0, 7]), n_messages=9, n_actions=7)
