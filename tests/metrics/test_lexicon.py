"""How languages are built, on languages made by hand, and beside emlangkit."""

import numpy as np
import pytest
from emlangkit.metrics import compute_posdis, compute_topographic_similarity
from scipy.stats import spearmanr

from sb3_guide.metrics import (
    agreement,
    by_chance,
    differences,
    edit_distances,
    joint_counts,
    p_value,
    positional_disentanglement,
    topographic_similarity,
)

GRID = np.array([(kind, colour) for kind in range(3) for colour in range(3)])  # every meaning once


def similarity(meanings: np.ndarray, messages: np.ndarray, weights: np.ndarray | None = None) -> float:
    return topographic_similarity(differences(meanings), edit_distances(messages), weights)


def test_a_language_with_a_symbol_for_each_attribute():
    assert similarity(GRID, GRID) == pytest.approx(1)
    assert positional_disentanglement(GRID, GRID) == pytest.approx(1)


def test_a_language_whose_symbols_mix_the_attributes():
    mixed = np.stack([GRID.sum(axis=1) % 3, (GRID[:, 0] + 2 * GRID[:, 1]) % 3], axis=1)
    assert positional_disentanglement(GRID, mixed) == pytest.approx(0)
    assert similarity(GRID, mixed) < 0.5


def test_one_word_for_everything_is_no_language():
    mute = np.zeros_like(GRID)
    assert np.isnan(similarity(GRID, mute))
    assert np.isnan(positional_disentanglement(GRID, mute))


@pytest.mark.parametrize("length", [2, 3])
def test_the_same_as_emlangkit(length):
    rng = np.random.default_rng(length)
    meanings = rng.integers(4, size=(60, 3))
    messages = (meanings[:, [0] * length] + rng.integers(2, size=(60, length))) % 3
    expected, _ = compute_topographic_similarity(messages, meanings)
    assert similarity(meanings, messages) == pytest.approx(expected)
    assert positional_disentanglement(meanings, messages) == pytest.approx(compute_posdis(messages, meanings))


def test_edit_distances():
    messages = np.array([[0, 1, 2], [1, 2, 0], [0, 1, 0]])
    # 012 to 120: leave out the first, put one in at the end
    assert edit_distances(messages).tolist() == [[0, 2, 1], [2, 0, 2], [1, 2, 0]]


def test_weights_are_how_often_a_frame_counts():
    rng = np.random.default_rng(0)
    meanings, messages, often = rng.integers(3, size=(20, 2)), rng.integers(3, size=(20, 2)), rng.integers(3, size=20)
    repeated = np.repeat(np.arange(20), often)
    assert positional_disentanglement(meanings, messages, often.astype(float)) == pytest.approx(
        positional_disentanglement(meanings[repeated], messages[repeated])
    )
    pairs = [(i, j) for i in repeated for j in repeated if i != j]  # a frame that is drawn twice is no pair with itself
    far = [tuple(distances[pair] for pair in pairs) for distances in (differences(meanings), edit_distances(messages))]
    assert similarity(meanings, messages, often.astype(float)) == pytest.approx(spearmanr(*far).statistic)


def test_shapes_that_do_not_fit():
    with pytest.raises(ValueError, match="expected two attributes or more"):
        positional_disentanglement(GRID[:, :1], GRID)
    with pytest.raises(ValueError, match=r"meanings \(9, 9\) and messages \(8, 8\)"):
        topographic_similarity(differences(GRID), edit_distances(GRID[1:]))


def test_the_same_language_in_other_words():
    said = np.array([0, 0, 1, 2, 2, 2])
    renamed = np.array([2, 0, 1])[said]
    assert agreement(joint_counts(said, renamed, 3, 3)) == 1
    renamed[0] = 0  # once something else
    assert agreement(joint_counts(said, renamed, 3, 3)) == pytest.approx(5 / 6)


def test_the_best_matching_is_not_the_greediest():
    counts = np.array([[5, 4], [4, 0]])
    assert agreement(counts) == pytest.approx(8 / 13)


def test_agreement_needs_as_many_messages():
    with pytest.raises(ValueError, match=r"counts \(2, 3\) of 6 frames"):
        agreement(np.ones((2, 3), dtype=int))


def test_agents_that_only_share_what_is_done_agree_by_chance_within_it():
    rng = np.random.default_rng(0)
    action = rng.integers(2, size=400)
    first, second = (2 * action + rng.integers(2, size=400) for _ in range(2))  # two words for each action, at random

    def agreed(order: np.ndarray) -> float:
        return agreement(joint_counts(first, second[order], 4, 4))

    observed = agreed(np.arange(400))
    assert p_value(observed, by_chance(agreed, np.zeros(400, dtype=int), rng, 200)) == pytest.approx(1 / 201)
    assert p_value(observed, by_chance(agreed, action, rng, 200)) > 0.05
