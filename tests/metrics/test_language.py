"""Counts of what goes together."""

import numpy as np
import pytest

from sb3_guide.metrics import conditional, joint_counts, obedience, symbol_information


def test_counts_and_conditional_distribution():
    counts = joint_counts(np.array([0, 0, 0, 2]), np.array([1, 1, 0, 2]), n_rows=3, n_columns=3)
    assert counts.tolist() == [[1, 2, 0], [0, 0, 0], [0, 0, 1]]
    distribution = conditional(counts)
    assert distribution[0].tolist() == pytest.approx([1 / 3, 2 / 3, 0])
    assert np.isnan(distribution[1]).all()
    assert distribution[2].tolist() == [0, 0, 1]


def test_no_frames_make_no_counts():
    none = np.zeros(0, dtype=np.int64)
    assert joint_counts(none, none, n_rows=2, n_columns=2).tolist() == [[0, 0], [0, 0]]


def test_frames_must_match():
    with pytest.raises(ValueError, match=r"rows \(2,\) and columns \(3,\) differ"):
        joint_counts(np.zeros(2, int), np.zeros(3, int), 2, 2)


def test_indices_out_of_range_are_named():
    with pytest.raises(ValueError, match="columns range from 0 to 7: expected 0 to 6"):
        joint_counts(np.array([0, 1]), np.array([0, 7]), n_rows=9, n_columns=7)


def test_the_position_that_carries_the_action_is_found():
    # two symbols of two words each; the action is the second symbol, the first says nothing
    counts = np.array([[500, 0], [0, 500], [500, 0], [0, 500]])
    assert symbol_information(counts, 2) == pytest.approx([0.0, np.log(2)], abs=1e-3)


def test_a_sum_of_symbols_is_in_neither_position():
    counts = np.array([[500, 0], [0, 500], [0, 500], [500, 0]])  # the action is the exclusive or of the two
    assert symbol_information(counts, 2) == pytest.approx([0.0, 0.0], abs=1e-3)


def test_information_of_few_independent_frames_is_not_overrated():
    rng = np.random.default_rng(0)
    found = [symbol_information(joint_counts(rng.integers(9, size=50), rng.integers(3, size=50), 9, 3), 2) for _ in range(400)]
    assert np.mean(found, axis=0) == pytest.approx([0.0, 0.0], abs=0.005)


def test_messages_of_another_length_have_no_positions():
    with pytest.raises(ValueError, match="a row for each message of 3 symbols"):
        symbol_information(np.ones((9, 7)), 3)


def test_obedience():
    meant, taken = np.array([0, 0, 1, 1, 2]), np.array([0, 0, 1, 0, 2])
    assert obedience(meant, taken) == pytest.approx((0.8, (0.8 - 0.6) / (1 - 0.6)))


def test_an_agent_with_one_action_has_no_obedience_beyond_chance():
    raw, corrected = obedience(np.array([0, 1]), np.array([0, 0]))
    assert raw == 0.5
    assert np.isnan(corrected)


def test_obedience_needs_messages():
    with pytest.raises(ValueError, match="differ or are empty"):
        obedience(np.zeros(0), np.zeros(0))
