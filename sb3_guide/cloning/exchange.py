"""
Episodes one by one, with rewards and the observation after the last action, as other libraries keep them.

Demonstrations hold neither, as cloning needs neither. Both are true all the same: levels are deterministic, so that an episode
is played again from its seed, and has to show the same images on the way.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sb3_guide.cloning.demonstrations import Demonstrations
from sb3_guide.cloning.episodes import WORLDS, Episodes
from sb3_guide.envs import ACTIONS, level_of
from sb3_guide.envs.batch import Batch

NO_SEED = -1  # of episodes whose missions can't be made again


@dataclass(frozen=True)
class WholeEpisode:
    """
    One episode of T actions.

    :param observations: "image" (T + 1, 7, 7, 3) uint8 and "mission" (T + 1, 72) uint8
    :param actions: (T,) int64
    :param rewards: (T,) float64
    :param terminations: (T,) bool whether the mission's end was reached
    :param truncations: (T,) bool whether time was up
    :param seed: of the mission
    """

    observations: dict[str, np.ndarray]
    actions: np.ndarray
    rewards: np.ndarray
    terminations: np.ndarray
    truncations: np.ndarray
    seed: int


class Replayed(NamedTuple):
    """
    What demonstrations don't hold of E episodes of F actions in all.

    :param rewards: (F,) float64
    :param last: (E, 7, 7, 3) uint8 images after the last actions
    :param terminated: (E,) bool
    :param truncated: (E,) bool
    """

    rewards: np.ndarray
    last: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray


def whole_episodes(demonstrations: Demonstrations) -> Iterator[WholeEpisode]:
    """
    :param demonstrations: of one level
    :return: its episodes, in order
    :raises ValueError: if the level is unknown, or an episode has no seed or, played again, is another one
    """
    episodes = demonstrations.episodes
    for start in range(0, len(episodes), WORLDS):
        some = episodes.select(np.arange(start, min(start + WORLDS, len(episodes))))
        played = replay(some, demonstrations.level)
        yield from (completed(some, played, episode) for episode in range(len(some)))


def replay(episodes: Episodes, level: str) -> Replayed:
    """
    Play episodes again, side by side.

    :param episodes: E of them
    :param level: name or id of their level
    :raises ValueError: if one has no seed, or is another one when it is played again
    """
    if (episodes.seeds < 0).any():
        raise ValueError("episodes without seeds can't be played again: expected demonstrations recorded by sb3-guide")
    batch, lengths, first = Batch(level_of(level), len(episodes), history=0), episodes.lengths, episodes.offsets[:-1]
    batch.seed(episodes.seeds.tolist())
    seen = batch.reset()
    same = (seen["mission"] == episodes.missions).all(axis=1)
    rewards, last = np.zeros(len(episodes.actions)), np.zeros_like(episodes.images[first])
    terminated, truncated = np.zeros((2, len(episodes)), dtype=bool)
    for time in range(lengths.max()):
        running = np.flatnonzero(time < lengths)
        now = first[running] + time  # their frames
        same[running] &= (seen["image"][running] == episodes.images[now]).all(axis=(1, 2, 3))
        actions = np.zeros(len(episodes), dtype=np.int64)
        actions[running] = episodes.actions[now]
        seen, reward, *ends = batch.step(actions, go_on=False)
        rewards[now] = reward[running]
        over = running[lengths[running] == time + 1]
        last[over] = seen["image"][over]
        terminated[over], truncated[over] = (end[over] for end in ends)
    same &= (terminated | truncated) & (returns_of(rewards, episodes.offsets) == episodes.returns)
    if not same.all():
        wrong = np.flatnonzero(~same)
        raise ValueError(
            f"{len(wrong)} of {len(same)} episodes of {level} are other ones when they are played again, the first of them "
            f"with seed {episodes.seeds[wrong[0]]}: expected demonstrations of this level and engine; record them anew"
        )
    return Replayed(rewards, last, terminated, truncated)


def completed(episodes: Episodes, played: Replayed, episode: int) -> WholeEpisode:
    """
    :param episodes: E of them
    :param played: what they don't hold
    :param episode: index of one of them
    :return: it
    """
    frames, length = slice(*episodes.offsets[episode : episode + 2]), episodes.lengths[episode]
    at_the_end = np.arange(length) == length - 1
    return WholeEpisode(
        observations={
            "image": np.concatenate([episodes.images[frames], played.last[[episode]]]),
            "mission": np.repeat(episodes.missions[[episode]], length + 1, axis=0),
        },
        actions=episodes.actions[frames].astype(np.int64),
        rewards=played.rewards[frames],
        terminations=at_the_end & played.terminated[episode],
        truncations=at_the_end & played.truncated[episode],
        seed=int(episodes.seeds[episode]),
    )


def returns_of(rewards: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """
    :param rewards: (F,) of all episodes
    :param offsets: (E + 1,) where each begins
    :return: (E,) float64 their returns as recording adds them up: rewards as SB3's VecEnvs give them, which is as float32
    """
    return np.add.reduceat(rewards.astype(np.float32).astype(np.float64), offsets[:-1])


def demonstrations_of(wholes: Iterable[WholeEpisode], level: str, provenance: dict[str, Any]) -> Demonstrations:
    """
    The opposite of :func:`whole_episodes`. Failed episodes are left out, as when recording.

    :param wholes: the episodes
    :param level: name or id of their level
    :param provenance: JSON that tells how they were made
    :raises ValueError: if none has succeeded, or images or actions are not such as our levels have
    """
    kept = [whole for whole in wholes if whole.rewards.sum() > 0]
    if not kept:
        raise ValueError("no episode has succeeded: expected at least one with a reward")
    images = np.concatenate([whole.observations["image"][:-1] for whole in kept])
    actions = np.concatenate([whole.actions for whole in kept])
    if images.dtype != np.uint8 or actions.min() < 0 or actions.max() >= len(ACTIONS):
        raise ValueError(
            f"images are {images.dtype} and actions from {actions.min()} to {actions.max()}: "
            f"expected uint8, and 0 to {len(ACTIONS) - 1}"
        )
    offsets = np.concatenate([[0], np.cumsum([len(whole.actions) for whole in kept])]).astype(np.int64)
    episodes = Episodes(
        images=images,
        actions=actions.astype(np.uint8),
        missions=np.stack([whole.observations["mission"][0] for whole in kept]),
        offsets=offsets,
        returns=returns_of(np.concatenate([whole.rewards for whole in kept]), offsets),
        seeds=np.array([whole.seed for whole in kept], dtype=np.int64),
    )
    return Demonstrations(episodes, level_of(level).name, provenance)
