"""Intervals that respect episodes, as frames of one episode are no independent witnesses; and what chance alone would give."""

from collections.abc import Callable

import numpy as np

RESAMPLES = 1000


def episode_sums(values: np.ndarray, episode: np.ndarray) -> np.ndarray:
    """
    :param values: (F, ...) of each frame
    :param episode: (F,) int64, which episode each frame belongs to, rising from 0 without a gap
    :return: (E, ...) float64, their sum in each episode
    :raises ValueError: if the two don't fit together
    """
    if episode.shape != values.shape[:1] or not len(episode) or episode[0] != 0 or not np.isin(np.diff(episode), (0, 1)).all():
        raise ValueError(f"episode {episode.shape} and values {values.shape}: expected an episode for each frame, 0, 1, 2 ...")
    return np.add.reduceat(values.astype(np.float64), np.flatnonzero(np.diff(episode, prepend=-1)), axis=0)


def ratio_interval(numerators: np.ndarray, denominators: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """
    95 % percentile interval of sum(numerators) / sum(denominators), whole episodes drawn with replacement a thousand times: of
    a mean over frames with sums and lengths, or of P(column|row) with counts and their rows' sums.

    :param numerators: (E, ...) of each episode
    :param denominators: (E, ...) that broadcasts to the same shape
    :param rng: that draws the episodes
    :return: (2, ...) float64, lower and upper bound; NaN where a denominator is nearly always 0
    :raises ValueError: if there is no episode
    """
    drawn = draw_episodes(len(numerators), rng)
    above, below = (np.tensordot(drawn, part, axes=1) for part in (numerators, denominators))
    with np.errstate(invalid="ignore", divide="ignore"):
        return bounds(np.where(below > 0, above / below, np.nan))


def interval(statistic: Callable[[np.ndarray], float | np.ndarray], episodes: int, rng: np.random.Generator) -> np.ndarray:
    """
    95 % percentile interval of any statistic, whole episodes drawn with replacement a thousand times.

    :param statistic: of (E,) float64, how often each episode counts
    :param episodes: E
    :param rng: that draws the episodes
    :return: (2, ...) float64, lower and upper bound; NaN where the statistic nearly always is
    :raises ValueError: if there is no episode
    """
    return bounds(np.array([statistic(weights) for weights in draw_episodes(episodes, rng)]))


def bounds(found: np.ndarray) -> np.ndarray:
    """
    :param found: (R, ...) of each resample
    :return: (2, ...) the middle 95 % of those that are known; NaN where more than half are not
    """
    missing = np.isnan(found).mean(axis=0) > 0.5
    return np.where(missing, np.nan, np.nanpercentile(np.where(missing, 0.0, found), (2.5, 97.5), axis=0))


def draw_episodes(episodes: int, rng: np.random.Generator) -> np.ndarray:
    """
    :param episodes: E
    :param rng: that draws them
    :return: (R, E) float64, how often each episode was drawn
    :raises ValueError: if there is no episode
    """
    if not episodes:
        raise ValueError("0 episodes: expected at least 1 to resample")
    return rng.multinomial(episodes, np.full(episodes, 1 / episodes), size=RESAMPLES).astype(np.float64)


def by_chance(
    statistic: Callable[[np.ndarray], float], strata: np.ndarray, rng: np.random.Generator, permutations: int = RESAMPLES
) -> np.ndarray:
    """
    Values of a statistic when what goes together is shuffled.

    :param statistic: of (N,) int64, the frame that takes the place of each frame
    :param strata: (N,) int64; frames are shuffled among those of the same stratum, all zeros for among all
    :param rng: that shuffles
    :param permutations: how often
    :return: (permutations,) float64
    """
    grouped, found = np.argsort(strata, kind="stable"), []
    for _ in range(permutations):
        order = np.empty(len(strata), dtype=np.int64)
        order[grouped] = np.lexsort((rng.random(len(strata)), strata))
        found.append(statistic(order))
    return np.array(found)


def p_value(observed: float, chance: np.ndarray) -> float:
    """
    :param observed: value of a statistic that is the greater, the more there is to be found
    :param chance: as :func:`by_chance` returns it
    :return: of a one-sided permutation test; never 0, as what was observed is one of the permutations; NaN if that is NaN
    """
    return float("nan") if np.isnan(observed) else float((1 + (chance >= observed).sum()) / (1 + len(chance)))
