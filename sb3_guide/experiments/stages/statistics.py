"""Intervals and tests, from scipy."""

import numpy as np
from scipy.stats import binomtest, t


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """
    :param successes: how many
    :param trials: of how many
    :return: bounds of the 95 % Wilson score interval of the success rate
    """
    interval = binomtest(successes, trials).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


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
    difference = a.astype(float) - b.astype(float)
    half = float(t.ppf(0.975, len(a) - 1) * difference.std(ddof=1) / np.sqrt(len(a)))
    only_a, only_b = int((a & ~b).sum()), int((b & ~a).sum())
    return {
        "difference": float(difference.mean()),
        "difference_low": max(float(difference.mean()) - half, -1.0),
        "difference_high": min(float(difference.mean()) + half, 1.0),
        "p_value": float(binomtest(only_a, only_a + only_b).pvalue) if only_a + only_b else 1.0,
    }
