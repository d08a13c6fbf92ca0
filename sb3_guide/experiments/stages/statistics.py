"""Intervals and tests."""

import math
from statistics import NormalDist

import numpy as np

Z = NormalDist().inv_cdf(0.975)  # of a 95 % interval


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """
    :param successes: how many
    :param trials: of how many
    :return: bounds of the 95 % Wilson score interval of the success rate
    """
    # in closed form, for every stage needs it, and scipy.stats takes a second to import
    rate, scale = successes / trials, 1 + Z**2 / trials
    middle = rate + Z**2 / (2 * trials)
    half = Z * math.sqrt(rate * (1 - rate) / trials + (Z / (2 * trials)) ** 2)
    low = 0.0 if successes == 0 else (middle - half) / scale
    high = 1.0 if successes == trials else (middle + half) / scale
    return low, high


def paired_successes(a: np.ndarray, b: np.ndarray) -> dict[str, float]:
    """
    Two outcomes of the same missions.

    :param a: (E,) bool
    :param b: (E,) bool
    :return: "difference" of the success rates, its 95 % interval ("difference_low", "difference_high", Student's t over
        missions, not beyond -1 and 1), and McNemar's exact "p_value"
    :raises ValueError: if the two differ in length, or there are fewer than two missions
    """
    if a.shape != b.shape or len(a) < 2:
        raise ValueError(f"outcomes of {len(a)} and {len(b)} missions: expected the same missions, at least 2")
    from scipy.stats import binomtest, t

    difference = a.astype(float) - b.astype(float)
    half = float(t.ppf(0.975, len(a) - 1) * difference.std(ddof=1) / np.sqrt(len(a)))
    only_a, only_b = int((a & ~b).sum()), int((b & ~a).sum())
    return {
        "difference": float(difference.mean()),
        "difference_low": max(float(difference.mean()) - half, -1.0),
        "difference_high": min(float(difference.mean()) + half, 1.0),
        "p_value": float(binomtest(only_a, only_a + only_b).pvalue) if only_a + only_b else 1.0,
    }
