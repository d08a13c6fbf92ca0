"""Intervals that respect episodes: frames of one episode are no independent witnesses."""

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
    episodes = len(numerators)
    if not episodes:
        raise ValueError("0 episodes: expected at least 1 to resample")
    drawn = rng.multinomial(episodes, np.full(episodes, 1 / episodes), size=RESAMPLES).astype(np.float64)  # (R, E)
    above, below = (np.tensordot(drawn, part, axes=1) for part in (numerators, denominators))
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = np.where(below > 0, above / below, np.nan)
    missing = np.isnan(ratios).mean(axis=0) > 0.5
    ratios = np.where(missing, 0.0, ratios)
    return np.where(missing, np.nan, np.nanpercentile(ratios, (2.5, 97.5), axis=0))
