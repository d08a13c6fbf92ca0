"""Intervals over episodes."""

import numpy as np
import pytest

from sb3_guide.metrics import by_chance, episode_sums, interval, p_value, ratio_interval


def test_sums_of_each_episode():
    values = np.array([[1, 10], [2, 20], [3, 30]])
    assert episode_sums(values, np.array([0, 0, 1])).tolist() == [[3, 30], [3, 30]]


@pytest.mark.parametrize("episode", [[0, 2, 2], [1, 1, 2], [0, 1, 0], [0, 0]])
def test_episodes_are_counted_without_a_gap(episode):
    with pytest.raises(ValueError, match="expected an episode for each frame"):
        episode_sums(np.ones(3), np.array(episode))


def test_the_interval_holds_the_mean_in_nineteen_of_twenty_samples():
    rng, held = np.random.default_rng(0), 0
    for _ in range(200):
        low, high = ratio_interval(rng.normal(5, 1, size=60), np.ones(60), rng)
        held += low <= 5 <= high
    assert held / 200 == pytest.approx(0.94, abs=0.04)


def test_frames_of_an_episode_are_one_witness():
    rng = np.random.default_rng(0)
    value, lengths = rng.normal(size=50), np.full(50, 100)
    by_episode = ratio_interval(value * lengths, lengths, np.random.default_rng(1))
    once = ratio_interval(value, np.ones(50), np.random.default_rng(1))
    assert by_episode == pytest.approx(once)


def test_rows_that_never_occur_have_no_interval():
    counts = np.zeros((20, 2, 2))
    counts[:, 0, 1] = 1
    bounds = ratio_interval(counts, counts.sum(axis=2, keepdims=True), np.random.default_rng(0))
    assert bounds[:, 0].tolist() == [[0, 1], [0, 1]]
    assert np.isnan(bounds[:, 1]).all()


def test_the_same_seed_gives_the_same_interval():
    a, b = (ratio_interval(np.arange(9), np.ones(9), np.random.default_rng(3)) for _ in range(2))
    assert a.tolist() == b.tolist()


def test_no_episode_has_no_interval():
    with pytest.raises(ValueError, match="0 episodes"):
        ratio_interval(np.zeros(0), np.zeros(0), np.random.default_rng(0))


def test_the_interval_of_any_statistic_is_that_of_a_ratio_where_it_is_one():
    rng = np.random.default_rng(0)
    sums, lengths = rng.normal(5, 1, size=30), rng.integers(1, 5, size=30)
    of_any = interval(lambda often: often @ sums / (often @ lengths), 30, np.random.default_rng(1))
    assert of_any == pytest.approx(ratio_interval(sums, lengths, np.random.default_rng(1)))


def test_chance_shuffles_within_strata_only():
    strata = np.array([0, 1, 0, 1, 0])
    seen = []

    def look(order: np.ndarray) -> float:
        seen.append(order)
        return 0.0

    by_chance(look, strata, np.random.default_rng(0), permutations=50)
    assert all((strata[order] == strata).all() and sorted(order) == list(range(5)) for order in seen)
    assert len({tuple(order) for order in seen}) > 5


def test_p_values_by_hand():
    assert p_value(3.0, np.array([1.0, 2.0, 3.0, 4.0])) == pytest.approx(3 / 5)
    assert p_value(9.0, np.zeros(99)) == pytest.approx(1 / 100)
    assert np.isnan(p_value(np.nan, np.zeros(99)))
