"""Intervals, from scipy."""

from scipy.stats import binomtest


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """
    :param successes: how many
    :param trials: of how many
    :return: bounds of the 95 % Wilson score interval of the success rate
    """
    interval = binomtest(successes, trials).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)
