"""Episodes as flat arrays, and how agents play them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch as th
from stable_baselines3.common.policies import BasePolicy

from sb3_guide.envs import GuideGridVecEnv, level_of
from sb3_guide.policies import AgentPolicy
from sb3_guide.policies.networks import GuideNetwork
from sb3_guide.policies.sequences import Sequences, history_of

WORLDS = 1024  # episodes that are played side by side


@dataclass(frozen=True)
class Episodes:
    """
    E episodes of F frames in all, one episode after the other.

    :param images: (F, 7, 7, 3) uint8 what was seen before each action
    :param actions: (F,) uint8
    :param missions: (E, 72) uint8 word ids
    :param offsets: (E + 1,) int64; episode e is frames offsets[e] to offsets[e + 1]
    :param returns: (E,) float64 sum of rewards; positive where the mission succeeded
    :param seeds: (E,) int64 seed of each mission
    :raises ValueError: if the arrays don't fit together
    """

    images: np.ndarray
    actions: np.ndarray
    missions: np.ndarray
    offsets: np.ndarray
    returns: np.ndarray
    seeds: np.ndarray

    def __post_init__(self) -> None:
        frames, episodes = len(self.actions), len(self.missions)
        fits = (
            self.images.shape == (frames, 7, 7, 3)
            and self.missions.ndim == 2
            and self.offsets.shape == (episodes + 1,)
            and self.returns.shape == self.seeds.shape == (episodes,)
            and self.offsets[0] == 0
            and self.offsets[-1] == frames
            and ((self.lengths > 0) & (self.lengths <= frames)).all()
            and self.actions.dtype.kind == self.missions.dtype.kind == "u"
            and self.offsets.dtype == self.seeds.dtype == np.int64
            and self.returns.dtype == np.float64
        )
        if not fits:
            shapes = {name: f"{array.dtype} {array.shape}" for name, array in self.arrays().items()}
            raise ValueError(f"arrays of {episodes} episodes and {frames} frames don't fit together: {shapes}")

    def arrays(self) -> dict[str, np.ndarray]:
        """:return: every array by its name"""
        return vars(self).copy()

    def __len__(self) -> int:
        return len(self.missions)

    @property
    def lengths(self) -> np.ndarray:
        """(E,) frames in each episode."""
        return np.diff(self.offsets)

    @property
    def successes(self) -> np.ndarray:
        """(E,) bool whether each mission succeeded."""
        return self.returns > 0

    def select(self, chosen: np.ndarray) -> "Episodes":
        """
        :param chosen: (N,) index of the episodes to keep, in the order to keep them
        """
        lengths = self.lengths[chosen]
        offsets = np.concatenate([[0], lengths.cumsum()])
        frames = ranges(self.offsets[chosen], lengths)
        return Episodes(
            self.images[frames], self.actions[frames], self.missions[chosen], offsets, self.returns[chosen], self.seeds[chosen]
        )

    def sequences(self) -> Sequences:
        """:return: the same as tensors, for the networks"""
        return Sequences(th.as_tensor(self.images), th.as_tensor(self.missions), th.as_tensor(self.lengths))

    def windows(self, history: int) -> Sequences:
        """
        What policies with window memory see of it.

        :param history: images before the present one
        :return: F sequences, each frame with those before it in its episode
        """
        present = np.arange(len(self.actions))
        first = np.maximum(present - history, np.repeat(self.offsets[:-1], self.lengths))
        images = self.images[ranges(first, present - first + 1)]
        missions = np.repeat(self.missions, self.lengths, axis=0)
        return Sequences(th.as_tensor(images), th.as_tensor(missions), th.as_tensor(present - first + 1))


def ranges(first: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """
    :param first: (N,) where each range begins
    :param lengths: (N,) of the ranges
    :return: all their numbers, one range after the other
    """
    return np.arange(lengths.sum()) + np.repeat(first - (lengths.cumsum() - lengths), lengths)


def concatenate(parts: list[Episodes]) -> Episodes:
    """
    :param parts: at least one
    :return: their episodes in order
    """
    lengths = np.concatenate([part.lengths for part in parts])
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in parts[0].arrays() if name != "offsets"}
    return Episodes(**joined, offsets=np.concatenate([[0], lengths.cumsum()]))


def play(
    policy: BasePolicy,
    level: str,
    seeds: np.ndarray,
    on_progress: Callable[[int], object] = lambda episodes: None,
    deterministic: bool = True,
) -> Episodes:
    """
    Play one episode of each mission, always sending the most probable message. Every mission counts, however long it takes:
    keeping the first to finish would favour short ones.

    :param policy: an SB3 policy for the level, with window memory, carried memory or none
    :param level: name or id of the level
    :param seeds: (E,) seed of each mission
    :param on_progress: called with the number of episodes that were finished since the last call
    :param deterministic: take the most probable action; else draw it, as SB3 does, from torch's global generator
    :return: E episodes in the order of the seeds
    :raises ValueError: if there are no seeds, or the policy's observation space is not the level's
    """
    if not len(seeds):
        raise ValueError("0 episodes were asked for: expected at least 1")
    if isinstance(policy, AgentPolicy) and isinstance(policy.network, GuideNetwork):
        policy.network.chance.manual_seed(0)  # what interventions draw is the same each time
    chunks = [np.asarray(seeds[start : start + WORLDS], dtype=np.int64) for start in range(0, len(seeds), WORLDS)]
    return concatenate([play_together(policy, level, chunk, on_progress, deterministic) for chunk in chunks])


def play_together(
    policy: BasePolicy, level: str, seeds: np.ndarray, on_progress: Callable[[int], object], deterministic: bool
) -> Episodes:
    """As :func:`play`, all missions side by side; worlds that are done are stepped along but no longer looked at."""
    venv = GuideGridVecEnv(level_of(level).env_id, len(seeds), history=history_of(policy.observation_space))
    if policy.observation_space != venv.observation_space:
        raise ValueError(
            f"the agent's observation space is not {level}'s: {policy.observation_space}, {venv.observation_space}"
        )
    obs: Any = venv.reset_to(seeds)
    missions, returns = obs["mission"].copy(), np.zeros(len(seeds))
    active, state = np.arange(len(seeds)), None
    worlds, images, actions = [], [], []
    while len(active):
        seen = {name: part[active] for name, part in obs.items()}
        chosen, state = policy.predict(seen, state, deterministic=deterministic)
        worlds.append(active)
        images.append(seen["image"])
        actions.append(chosen)
        every = np.zeros(len(seeds), dtype=np.int64)
        every[active] = chosen
        obs, rewards, dones, _ = venv.step(every)
        returns[active] += rewards[active]
        goes_on = ~dones[active]
        on_progress(int(dones[active].sum()))
        active = active[goes_on]
        state = None if state is None else tuple(part[:, goes_on] for part in state)
    order = np.argsort(np.concatenate(worlds), kind="stable")  # by episode, then by time
    lengths = np.bincount(np.concatenate(worlds))
    return Episodes(
        images=np.concatenate(images)[order],
        actions=np.concatenate(actions)[order].astype(np.uint8),
        missions=missions,
        offsets=np.concatenate([[0], lengths.cumsum()]),
        returns=returns,
        seeds=seeds,
    )
