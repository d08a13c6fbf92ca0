"""
How a language is built, and whether two agents speak the same one. Of messages as short as these, such numbers say little by
themselves: read them beside those that :func:`~sb3_guide.metrics.resampling.by_chance` gives.
"""

import numpy as np

from sb3_guide.metrics.language import plain_information


def topographic_similarity(meanings: np.ndarray, messages: np.ndarray, weights: np.ndarray | None = None) -> float:
    """
    Whether similar messages are said of similar things (Brighton and Kirby 2006): Spearman's correlation of the distances of
    meanings and of messages, over all pairs of frames.

    :param meanings: (N, N) int64, such as :func:`differences` in attributes
    :param messages: (N, N) int64, such as :func:`edit_distances`
    :param weights: (N,) a pair counts as the product of its frames' weights, which are 1 for None; a frame is no pair with
        itself, however much it counts
    :return: from -1 to 1; NaN where all meanings or all messages are equally far from each other
    :raises ValueError: if the two differ in shape
    """
    if meanings.shape != messages.shape or meanings.ndim != 2 or not meanings.size:
        raise ValueError(
            f"distances of meanings {meanings.shape} and messages {messages.shape}: expected (frames, frames) both"
        )
    often = np.ones(len(messages)) if weights is None else weights
    pairs = np.outer(often, often)
    np.fill_diagonal(pairs, 0)  # a frame is no pair with itself
    rows, columns = int(meanings.max()) + 1, int(messages.max()) + 1
    return rank_correlation(np.bincount((meanings * columns + messages).ravel(), pairs.ravel(), rows * columns), columns)


def rank_correlation(counts: np.ndarray, columns: int) -> float:
    """
    :param counts: (R * C,) how often the values 0 to R - 1 and 0 to C - 1 came together
    :param columns: C
    :return: Spearman's correlation
    """
    joint = counts.reshape(-1, columns) / counts.sum()
    margins = joint.sum(axis=1), joint.sum(axis=0)
    rows, cells = (margin.cumsum() - margin / 2 - 0.5 for margin in margins)  # mean ranks of tied values, around 0
    spread = (margins[0] @ rows**2) * (margins[1] @ cells**2)
    return float(rows @ joint @ cells / np.sqrt(spread)) if spread > 0 else float("nan")


def differences(meanings: np.ndarray) -> np.ndarray:
    """
    :param meanings: (N, K) value of each attribute
    :return: (N, N) int64, in how many attributes each two differ
    """
    return (meanings[:, None] != meanings[None]).sum(axis=2)


def edit_distances(messages: np.ndarray) -> np.ndarray:
    """
    :param messages: (N, L) symbols
    :return: (N, N) int64, how many symbols must be put in, left out or replaced to turn one into the other (Levenshtein 1966)
    """
    frames, length = messages.shape
    unequal = messages[:, None, :, None] != messages[None, :, None, :]  # (N, N, L, L)
    row = [np.full((frames, frames), column) for column in range(length + 1)]
    for first in range(length):
        above, row = row, [np.full((frames, frames), first + 1)]
        for second in range(length):
            replaced = above[second] + unequal[:, :, first, second]
            row.append(np.minimum(replaced, np.minimum(above[second + 1], row[second]) + 1))
    return row[length]


def positional_disentanglement(meanings: np.ndarray, messages: np.ndarray, weights: np.ndarray | None = None) -> float:
    """
    Whether each position of the message is about one attribute of what was seen (Chaabouni et al. 2020): the gap between the
    two attributes that its symbol tells most of, as a share of the symbol's entropy; the mean over positions.

    :param meanings: (N, K) int64 value of each attribute, from 0, of at least two
    :param messages: (N, L) int64 symbols
    :param weights: (N,) how often each frame counts; None for once
    :return: from 0 to 1; NaN where all messages are the same
    :raises ValueError: if the two differ in length, or there is only one attribute
    """
    if len(meanings) != len(messages) or meanings.ndim != 2 or meanings.shape[1] < 2:
        raise ValueError(f"meanings {meanings.shape} and messages {messages.shape}: expected two attributes or more a frame")
    gaps = []
    for symbols in messages.T:
        tables = [weighted_counts(symbols, attribute, weights) for attribute in meanings.T]
        of_symbol = plain_information(np.diag(tables[0].sum(axis=1)))  # its entropy: what it tells about itself
        second, first = np.sort([plain_information(table) for table in tables])[-2:]
        if of_symbol > 0:
            gaps.append((first - second) / of_symbol)
    return float(np.mean(gaps)) if gaps else float("nan")


def weighted_counts(rows: np.ndarray, columns: np.ndarray, weights: np.ndarray | None) -> np.ndarray:
    """:return: (R, C) how often each row came with each column"""
    width = int(columns.max()) + 1
    counts = np.bincount(rows * width + columns, weights, (int(rows.max()) + 1) * width)
    return counts.reshape(-1, width)


def agreement(counts: np.ndarray) -> float:
    """
    How far two agents speak the same language in other words: the share of frames in which they say the same, once each word
    of the one is matched with a word of the other in the best way.

    :param counts: (M, M) how often each message of the one came with each of the other, at the same frames
    :return: from 1 / M to 1
    :raises ValueError: if the table is not square, or nothing was counted
    """
    from scipy.optimize import linear_sum_assignment  # of the extra experiments

    if counts.ndim != 2 or counts.shape[0] != counts.shape[1] or not counts.sum():
        raise ValueError(
            f"counts {counts.shape} of {counts.sum()} frames: expected as many messages of the one as of the other"
        )
    matched = linear_sum_assignment(counts, maximize=True)
    return float(counts[matched].sum() / counts.sum())
