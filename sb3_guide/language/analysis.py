"""All that is measured of what was read, as JSON, every number with its 95 % interval over episodes (paper section 5)."""

import math
from functools import partial
from typing import Any

import numpy as np
import torch as th

from sb3_guide.language.reading import Reading
from sb3_guide.language.situations import SITUATIONS, meanings, situations, targets
from sb3_guide.metrics import (
    by_chance,
    cic,
    cic_as_published,
    conditional,
    differences,
    edit_distances,
    episode_sums,
    influence,
    interval,
    joint_counts,
    message_entropy,
    p_value,
    positional_disentanglement,
    positive_signalling,
    ratio_interval,
    symbol_information,
    tempered,
    topographic_similarity,
    uniform_cic,
)


def tables(reading: Reading) -> dict[str, Any]:
    """:return: which actions follow which messages: counts, and intervals (2, M, A) of the conditional probabilities"""
    actions = actions_by_episode(reading)
    return {
        "counts": actions.sum(axis=0).tolist(),
        "action_intervals": conditional_intervals(actions),
        "action_information": informations(actions, reading.shape.length),
    }


def in_situations(reading: Reading) -> dict[str, Any]:
    """:return: which messages are spoken where: counts and intervals as in :func:`tables`, with the target in each cell too"""
    n_messages, found = reading.shape.count, targets(reading.episodes)
    situation = situations(found)
    inside = np.flatnonzero(situation >= 0)
    frame, across, down = found.nonzero()
    cells = by_episode(reading, frame, across * found.shape[2] + down, reading.messages[frame], found[0].size, n_messages)
    spoken = by_episode(reading, inside, situation[inside], reading.messages[inside], len(SITUATIONS), n_messages)
    return {
        "situations": list(SITUATIONS),
        "situation_counts": spoken.sum(axis=0).tolist(),
        "situation_intervals": conditional_intervals(spoken),
        "situation_information": informations(spoken.transpose(0, 2, 1), reading.shape.length),
        "cell_counts": cells.sum(axis=0).reshape(*found.shape[1:], n_messages).tolist(),
        "cell_intervals": conditional_intervals(cells),
    }


def actions_by_episode(reading: Reading) -> np.ndarray:
    """:return: (E, M, A) int64, how often each action followed each message in each episode"""
    every = np.arange(len(reading.messages))
    return by_episode(reading, every, reading.messages, reading.episodes.actions, reading.shape.count, len(reading.actions))


def by_episode(
    reading: Reading, frames: np.ndarray, rows: np.ndarray, columns: np.ndarray, n_rows: int, n_columns: int
) -> np.ndarray:
    """
    :param frames: (K,) to count
    :param rows: (K,)
    :param columns: (K,)
    :return: (E, R, C) int64, how often each row came with each column in each episode
    """
    n_episodes = len(reading.episodes)
    counts = joint_counts(reading.episode[frames] * n_rows + rows, columns, n_episodes * n_rows, n_columns)
    return counts.reshape(n_episodes, n_rows, n_columns)


def conditional_intervals(counts: np.ndarray) -> list[Any]:
    """
    :param counts: (E, R, C) of each episode
    :return: (2, R, C) bounds of P(column|row), None where a row hardly occurs
    """
    return without_nan(ratio_interval(counts, counts.sum(axis=2, keepdims=True), np.random.default_rng(0)))


def informations(counts: np.ndarray, length: int) -> list[dict[str, float]]:
    """
    :param counts: (E, M, C) how often each message came with each of something else
    :param length: symbols in a message
    :return: what each symbol tells about it, in nats
    """
    found = symbol_information(counts.sum(axis=0), length)
    low, high = interval(
        lambda often: symbol_information(np.tensordot(often, counts, axes=1), length), len(counts), np.random.default_rng(0)
    )
    return [{"mean": float(found[at]), "low": float(low[at]), "high": float(high[at])} for at in range(length)]


def communication(reading: Reading) -> dict[str, dict[str, float]]:
    """:return: mean over the frames, and its interval, of each measure of communication, in nats"""
    found = {}
    for name, values in influences(reading).items():
        sums = episode_sums(values.numpy(), reading.episode)
        low, high = ratio_interval(sums, reading.episodes.lengths, np.random.default_rng(0))
        found[name] = {"mean": float(values.mean()), "low": float(low), "high": float(high)}
    spoken, episode = reading.message_log_probs, reading.episode

    def signalled(often: np.ndarray) -> float:
        return positive_signalling(spoken, th.as_tensor(often[episode], dtype=spoken.dtype))

    low, high = interval(signalled, len(reading.episodes), np.random.default_rng(0))
    return found | {"positive_signalling": {"mean": positive_signalling(spoken), "low": float(low), "high": float(high)}}


def influences(reading: Reading) -> dict[str, th.Tensor]:
    """
    :return: (F,) of each frame: CIC in its variants, message entropy, and the influence of the very message that was heard,
        from what the Learner would do on hearing the Guide's other messages, and on hearing any
    """
    spoken, acted, heard = reading.message_log_probs, reading.action_log_probs, th.as_tensor(reading.messages)
    any_message = th.full_like(spoken, -math.log(spoken.shape[1]))
    return {
        "cic": cic(spoken, acted),
        "cic_as_published": cic_as_published(spoken, acted),
        "uniform_cic": uniform_cic(acted),
        "tempered_cic": cic(tempered(spoken, math.log(spoken.shape[1]) / 2), acted),
        "message_entropy": message_entropy(spoken),
        "influence": influence(heard, spoken, acted),
        "influence_among_all": influence(heard, any_message, acted),
    }


def structure(reading: Reading) -> dict[str, dict[str, float | None]]:
    """
    How the language is built, on one frame of each episode, drawn at random.

    :return: "topographic_similarity" and "positional_disentanglement" with respect to where the target is and what it is; each
        with its interval, its mean when messages are shuffled, and the p-value of that; None where all messages are the same
    """
    rng, episodes = np.random.default_rng(0), reading.episodes
    frames = episodes.offsets[:-1] + rng.integers(episodes.lengths)
    seen = meanings(episodes, targets(episodes))[frames]
    said = reading.shape.all().numpy()[reading.messages[frames]]
    apart, edits = differences(seen), edit_distances(said)

    def similarity(order: np.ndarray, often: np.ndarray | None = None) -> float:
        return topographic_similarity(apart, edits[np.ix_(order, order)], often)

    def disentanglement(order: np.ndarray, often: np.ndarray | None = None) -> float:
        return positional_disentanglement(seen, said[order], often)

    found, as_said = {}, np.arange(len(frames))
    for name, statistic in (("topographic_similarity", similarity), ("positional_disentanglement", disentanglement)):
        low, high = interval(partial(statistic, as_said), len(frames), rng)
        shuffled = by_chance(statistic, np.zeros(len(frames), dtype=np.int64), rng)
        value = statistic(as_said)
        numbers = np.array([value, low, high, shuffled.mean(), p_value(value, shuffled)])
        found[name] = dict(zip(("value", "low", "high", "by_chance", "p_value"), without_nan(numbers), strict=True))
    return found


def change(before: Reading, after: Reading) -> dict[str, Any]:
    """
    What became of the words of a Guide when a Learner came to hear it (paper figure A.1).

    :param before: of the Guide
    :param after: of the Learner, on the same missions
    :return: P(action|message) afterwards less before, and its intervals, missions resampled; None where a message hardly
        occurs in one of them
    """
    counts = [actions_by_episode(reading) for reading in (before, after)]

    def difference(often: np.ndarray) -> np.ndarray:
        earlier, later = (conditional(np.tensordot(often, part, axes=1)) for part in counts)
        return later - earlier

    missions = len(before.episodes)
    return {
        "counts_before": counts[0].sum(axis=0).tolist(),
        "change": without_nan(difference(np.ones(missions))),
        "change_intervals": without_nan(interval(difference, missions, np.random.default_rng(0))),
    }


def without_nan(values: np.ndarray) -> list[Any]:
    """:return: the same for JSON, None instead of NaN"""
    return np.where(np.isnan(values), np.array(None), values).tolist()
