"""Contrasts of two conditions, paired by seed, and what they say of a claim (docs/results/guidance/criteria.md)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.integrate import trapezoid
from scipy.stats import permutation_test, ttest_rel
from statsmodels.stats.multitest import multipletests

DONE = 0.95  # mean success at which a condition has learned the level
SMALLEST = 0.02  # difference that matters
MARGINS = {"as-good": 0.05, "as-good-in-the-end": 0.01}  # within which two conditions are equal
SIGNIFICANT = 0.05
FEWEST = 2  # seeds that have a spread


@dataclass(frozen=True)
class Contrast:
    """
    A minus B, paired by seed.

    :param level: name
    :param a: condition
    :param b: condition
    :param horizon: episodes up to which areas are taken; None where final successes are compared
    :param seeds: how many both have
    :param mean_a: of A
    :param mean_b: of B
    :param low, high: bounds of the 95 % interval of the difference
    :param low_90, high_90: of the 90 % interval, for two one-sided tests
    :param p_value: of the paired t-test
    :param p_exact: of all sign flips
    """

    level: str
    a: str
    b: str
    horizon: int | None
    seeds: int
    mean_a: float
    mean_b: float
    low: float
    high: float
    low_90: float
    high_90: float
    p_value: float
    p_exact: float

    @property
    def difference(self) -> float:
        """A minus B."""
        return self.mean_a - self.mean_b


def area(episodes: np.ndarray, success: np.ndarray, horizon: float) -> float:
    """
    :param episodes: (n,) seen at each validation, rising from 0
    :param success: (n,) then
    :param horizon: up to which the area is taken
    :return: mean success while learning up to the horizon, in [0, 1]
    """
    inside = episodes < horizon
    x = np.append(episodes[inside], horizon)
    y = np.append(success[inside], np.interp(horizon, episodes, success))
    return float(trapezoid(y, x) / horizon)


def episodes_to(episodes: np.ndarray, success: np.ndarray, threshold: float) -> float:
    """
    :param episodes: (n,) seen at each validation
    :param success: (n,) then
    :param threshold: of success
    :return: episodes seen at the first validation at or above it; those of the last one if it is never reached
    """
    reached = np.flatnonzero(success >= threshold)
    return float(episodes[reached[0]] if len(reached) else episodes[-1])


def horizon_of(a: pd.DataFrame, b: pd.DataFrame) -> int:
    """
    :param a: success of a condition, a row a validation (by episodes seen), a column a seed
    :param b: of another one
    :return: episodes at the first validation at which the means of both have reached DONE, or the last common one
    """
    means = pd.concat([a.mean(axis=1), b.mean(axis=1)], axis=1, join="inner")
    done = means.index[(means >= DONE).all(axis=1)]
    return int(done[0] if len(done) else means.index[-1])


def paired(level: str, a: str, b: str, horizon: int | None, values_a: np.ndarray, values_b: np.ndarray) -> Contrast:
    """
    :param values_a: (n,) of A, a seed each
    :param values_b: (n,) of B, of the same seeds
    :return: their contrast; NaN where there are fewer than two seeds
    """
    seeds, means = len(values_a), (float(values_a.mean()), float(values_b.mean()))
    difference = values_a - values_b
    if seeds < FEWEST:
        return Contrast(level, a, b, horizon, seeds, *means, *(np.nan,) * 6)
    if np.ptp(difference) == 0:  # where a t-test divides by the spread
        always, p_values = means[0] - means[1], (0.0, 2.0 ** (1 - seeds)) if difference.any() else (np.nan, np.nan)
        return Contrast(level, a, b, horizon, seeds, *means, always, always, always, always, *p_values)
    test = ttest_rel(values_a, values_b)
    wide, narrow = test.confidence_interval(0.95), test.confidence_interval(0.9)
    exact = permutation_test((values_a, values_b), lambda x, y: np.mean(x - y), permutation_type="samples", random_state=0)
    numbers = (wide.low, wide.high, narrow.low, narrow.high, test.pvalue, exact.pvalue)
    return Contrast(level, a, b, horizon, seeds, *means, *map(float, numbers))


def corrected(contrasts: Sequence[Contrast]) -> list[float]:
    """:return: p-value of each contrast after Holm's correction for all of them; NaN stays NaN"""
    p_values = np.array([contrast.p_value for contrast in contrasts])
    known = ~np.isnan(p_values)
    if known.any():
        p_values[known] = multipletests(p_values[known], method="holm")[1]
    return p_values.tolist()


def verdict(kind: str, contrast: Contrast, p_value: float) -> str:
    """
    :param kind: of the claim, as claims.yml has it
    :param contrast: of A and B
    :param p_value: corrected
    :return: "holds", "contradicted", "does not hold", "not shown" or "undecided"
    """
    if kind in MARGINS:
        margin = MARGINS[kind]
        if -margin <= contrast.low_90 and contrast.high_90 <= margin:
            return "holds"
        return "does not hold" if contrast.low_90 > margin or contrast.high_90 < -margin else "undecided"
    if p_value < SIGNIFICANT and abs(contrast.difference) >= SMALLEST:
        return "holds" if contrast.difference > 0 else "contradicted"
    return "not shown"


def verdict_of_all(verdicts: Sequence[str]) -> str:
    """
    :param verdicts: of the contrasts of a claim that were run
    :return: of the claim
    """
    held = verdicts.count("holds")
    failed = verdicts.count("contradicted") + verdicts.count("does not hold")
    if not verdicts:
        return "not run"
    if held == len(verdicts):
        return "holds"
    if held:
        return "is mixed" if failed else "holds partly"
    return "does not hold" if failed else "is not shown"
