"""Contrasts on cases worked out by hand."""

import math

import numpy as np
import pandas as pd
import pytest

from sb3_guide.experiments.report.contrasts import (
    area,
    corrected,
    episodes_to,
    horizon_of,
    paired,
    verdict,
    verdict_of_all,
)

EPISODES = np.array([0, 10, 20, 40])


def contrast(a: list[float], b: list[float]):
    return paired("GoToObj", "a", "b", 40, np.array(a), np.array(b))


def test_the_area_is_the_mean_success_up_to_the_horizon():
    success = np.array([0.0, 0.5, 1.0, 1.0])
    assert area(EPISODES, success, 40) == pytest.approx((2.5 + 7.5 + 20) / 40)
    assert area(EPISODES, success, 10) == pytest.approx(0.25)
    assert area(EPISODES, success, 15) == pytest.approx((2.5 + 5 * 0.625) / 15)
    assert area(EPISODES, np.ones(4), 40) == 1


def test_episodes_to_a_threshold_are_censored_at_the_end():
    success = np.array([0.0, 0.9, 0.8, 0.95])
    assert [episodes_to(EPISODES, success, threshold) for threshold in (0.5, 0.9, 0.95, 0.99)] == [10, 10, 40, 40]


def test_the_horizon_is_where_both_have_learned_the_level():
    fast = pd.DataFrame({0: [0, 0.96, 1, 1], 1: [0, 0.96, 1, 1]}, index=EPISODES)
    slow = pd.DataFrame({0: [0, 0.1, 1, 1], 1: [0, 0.1, 0.88, 1]}, index=EPISODES)
    assert horizon_of(fast, slow) == horizon_of(slow, fast) == 40
    assert horizon_of(fast, fast) == 10
    assert horizon_of(fast, slow * 0.5) == 40
    assert horizon_of(fast.loc[:20], slow * 0.5) == 20  # the last one that both have


def test_a_paired_t_test():
    """Differences 1, 2, 3: mean 2, standard error 1/sqrt(3), t(2) = 3.4641, p = 0.0742, t quantiles 4.3027 and 2.9200."""
    found = contrast([2, 4, 6], [1, 2, 3])
    assert (found.seeds, found.difference) == (3, 2)
    assert found.p_value == pytest.approx(0.0742, abs=1e-4)
    assert (found.low, found.high) == pytest.approx((2 - 4.3027 / math.sqrt(3), 2 + 4.3027 / math.sqrt(3)), abs=1e-4)
    assert (found.low_90, found.high_90) == pytest.approx((2 - 2.92 / math.sqrt(3), 2 + 2.92 / math.sqrt(3)), abs=1e-4)
    assert found.p_exact == pytest.approx(2 / 2**3)


def test_one_seed_decides_nothing():
    found = contrast([0.9], [0.1])
    assert math.isnan(found.p_value)
    assert verdict("faster", found, found.p_value) == "not shown"
    assert verdict("as-good", found, found.p_value) == "undecided"


def test_equal_differences_have_no_spread():
    found = contrast([0.5, 0.6], [0.5, 0.6])
    assert verdict("as-good", found, found.p_value) == "holds"
    assert verdict("faster", found, found.p_value) == "not shown"
    always = contrast([0.5, 0.75], [0.25, 0.5])
    assert (always.p_value, always.p_exact) == (0, 0.5)  # two of four flips of signs are as extreme
    assert verdict("faster", always, always.p_value) == "holds"


def test_holms_correction():
    """Of 0.01, 0.04 and 0.03: three times the smallest, twice the next, and never less than those before."""
    contrasts = [contrast([2, 4, 6], [1, 2, 3]) for _ in range(4)]
    for each, p_value in zip(contrasts, (0.01, 0.04, math.nan, 0.03), strict=True):
        object.__setattr__(each, "p_value", p_value)
    found = corrected(contrasts)
    assert found[:2] + found[3:] == pytest.approx([0.03, 0.06, 0.06])
    assert math.isnan(found[2])


@pytest.mark.parametrize(
    ("kind", "a", "b", "expected"),
    [
        ("faster", [0.5, 0.51, 0.52], [0.4, 0.4, 0.4], "holds"),
        ("faster", [0.4, 0.4, 0.4], [0.5, 0.51, 0.52], "contradicted"),
        ("faster", [0.401, 0.4011, 0.4012], [0.4, 0.4, 0.4], "not shown"),  # too small to matter
        ("faster", [0.9, 0.1, 0.5], [0.4, 0.4, 0.4], "not shown"),
        ("as-good", [0.5, 0.51, 0.5], [0.5, 0.5, 0.51], "holds"),
        ("as-good", [0.9, 0.91, 0.9], [0.5, 0.5, 0.5], "does not hold"),
        ("as-good", [0.9, 0.1, 0.5], [0.5, 0.5, 0.5], "undecided"),
        ("as-good-in-the-end", [0.97, 0.971, 0.97], [0.95, 0.95, 0.95], "does not hold"),
        ("better-in-the-end", [0.5, 0.51, 0.52], [0.4, 0.4, 0.4], "holds"),
    ],
)
def test_verdicts(kind: str, a: list[float], b: list[float], expected: str):
    found = contrast(a, b)
    assert verdict(kind, found, found.p_value) == expected


@pytest.mark.parametrize(
    ("verdicts", "expected"),
    [
        ([], "not run"),
        (["holds", "holds"], "holds"),
        (["holds", "not shown"], "holds partly"),
        (["holds", "contradicted"], "is mixed"),
        (["not shown", "does not hold"], "does not hold"),
        (["not shown", "undecided"], "is not shown"),
    ],
)
def test_a_claim_over_several_contrasts(verdicts: list[str], expected: str):
    assert verdict_of_all(verdicts) == expected
