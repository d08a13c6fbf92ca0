"""Episodes as flat arrays, and how agents play them."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.policies import BasePolicy

from sb3_guide.envs import GuideGridVecEnv, Worlds, is_level, worlds_of
from sb3_guide.policies import AgentPolicy
from sb3_guide.policies.networks import GuideNetwork
from sb3_guide.policies.sequences import MISSION_CHANGED, Sequences, history_of

WORLDS = 1024  # episodes that are played side by side
OTHER_WORLDS = 8  # where every world is an environment of its own, and may take long to make


@dataclass(frozen=True)
class Episodes:
    """
    E episodes of F frames in all, one episode after the other.

    :param images: (F, ...) what was seen before each action, as the agent's observation space has it
    :param actions: (F,) uint8, or int64 where there are more than 256
    :param missions: (E, words) word ids; where there are no missions, one word of padding
    :param offsets: (E + 1,) int64; episode e is frames offsets[e] to offsets[e + 1]
    :param returns: (E,) float64 sum of rewards
    :param seeds: (E,) int64 seed of each mission
    :param succeeded: (E,) bool whether each mission succeeded; None where that is a positive return
    :raises ValueError: if the arrays don't fit together
    """

    images: np.ndarray
    actions: np.ndarray
    missions: np.ndarray
    offsets: np.ndarray
    returns: np.ndarray
    seeds: np.ndarray
    succeeded: np.ndarray | None = None

    def __post_init__(self) -> None:
        frames, episodes = len(self.actions), len(self.missions)
        fits = (
            self.images.ndim == 4
            and len(self.images) == frames
            and self.missions.ndim == 2
            and self.offsets.shape == (episodes + 1,)
            and self.returns.shape == self.seeds.shape == (episodes,)
            and self.offsets[0] == 0
            and self.offsets[-1] == frames
            and ((self.lengths > 0) & (self.lengths <= frames)).all()
            and self.actions.dtype.kind in "iu"
            and self.missions.dtype.kind in "iu"
            and self.offsets.dtype == self.seeds.dtype == np.int64
            and self.returns.dtype == np.float64
            and (self.succeeded is None or (self.succeeded.shape == (episodes,) and self.succeeded.dtype == np.bool_))
        )
        if not fits:
            shapes = {name: f"{array.dtype} {array.shape}" for name, array in self.arrays().items()}
            raise ValueError(f"arrays of {episodes} episodes and {frames} frames don't fit together: {shapes}")

    def arrays(self) -> dict[str, np.ndarray]:
        """:return: every array that there is by its name"""
        return {name: array for name, array in vars(self).items() if array is not None}

    def __len__(self) -> int:
        return len(self.missions)

    @property
    def lengths(self) -> np.ndarray:
        """(E,) frames in each episode."""
        return np.diff(self.offsets)

    @property
    def successes(self) -> np.ndarray:
        """(E,) bool whether each mission succeeded."""
        return self.returns > 0 if self.succeeded is None else self.succeeded

    def select(self, chosen: np.ndarray) -> "Episodes":
        """
        :param chosen: (N,) index of the episodes to keep, in the order to keep them
        """
        lengths = self.lengths[chosen]
        offsets = np.concatenate([[0], lengths.cumsum()])
        frames = ranges(self.offsets[chosen], lengths)
        of_frames = {name: getattr(self, name)[frames] for name in ("images", "actions")}
        others = {name: array[chosen] for name, array in self.arrays().items() if name not in (*of_frames, "offsets")}
        return Episodes(**of_frames, **others, offsets=offsets)

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
        shows = np.where(self.images.reshape(len(present), -1).any(axis=1), present, len(present))
        next_shown = np.minimum.accumulate(shows[::-1])[::-1]
        first = np.minimum(next_shown[first], present)  # as policies leave out blank images at the start of a window
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
    names = ("images", "actions", "missions", "returns", "seeds")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    known = any(part.succeeded is not None for part in parts)
    succeeded = np.concatenate([part.successes for part in parts]) if known else None
    return Episodes(**joined, offsets=np.concatenate([[0], lengths.cumsum()]), succeeded=succeeded)


def play(
    policy: BasePolicy,
    level: str,
    seeds: np.ndarray,
    on_progress: Callable[[int], object] = lambda episodes: None,
    deterministic: bool = True,
) -> Episodes:
    """
    Play one episode of each mission, always sending the most probable message. Every mission counts, however long it takes:
    keeping the first to finish would favour short ones. An episode succeeds where its last info says ``is_success``, or, if it
    says nothing, where the rewards add up to more than 0.

    :param policy: an SB3 policy for the environment, with window memory, carried memory or none
    :param level: name or id of a level, or id of another environment, whose episodes must end
    :param seeds: (E,) seed of each mission
    :param on_progress: called with the number of episodes that were finished since the last call
    :param deterministic: take the most probable action; else draw it, as SB3 does, from torch's global generator
    :return: E episodes in the order of the seeds
    :raises ValueError: if there are no seeds, the policy's observation space is not the environment's, or a mission changes
        within an episode
    """
    if not len(seeds):
        raise ValueError("0 episodes were asked for: expected at least 1")
    if isinstance(policy, AgentPolicy) and isinstance(policy.network, GuideNetwork):
        policy.network.chance.manual_seed(0)  # what interventions draw is the same each time
    at_once = worlds_at_once(level, len(seeds))
    chunks = [np.asarray(seeds[start : start + at_once], dtype=np.int64) for start in range(0, len(seeds), at_once)]
    with closing(worlds_of(level, at_once, history_of(policy.observation_space))) as worlds:
        names = check_sees(policy, worlds.observation_space, level)
        return concatenate([play_together(policy, worlds, names, chunk, on_progress, deterministic) for chunk in chunks])


def worlds_at_once(level: str, n_missions: int) -> int:
    """:return: how many worlds to make for so many missions"""
    return min(n_missions, WORLDS if is_level(level) else OTHER_WORLDS)


def play_together(
    policy: BasePolicy,
    venv: GuideGridVecEnv | Worlds,
    names: list[str],
    seeds: np.ndarray,
    on_progress: Callable[[int], object],
    deterministic: bool,
) -> Episodes:
    """
    As :func:`play`, all missions side by side; worlds that are done, or more than there are missions, are not looked at.

    :param venv: at least as many worlds
    :param names: what the policy looks at of what they show
    """
    assert isinstance(venv.action_space, spaces.Discrete)
    obs: Any = venv.reset_to(np.resize(seeds, venv.num_envs))
    missions = obs["mission"][: len(seeds)].copy() if "mission" in names else np.zeros((len(seeds), 1), dtype=np.uint8)
    returns, succeeded = np.zeros(len(seeds)), np.zeros(len(seeds), dtype=bool)
    active, state = np.arange(len(seeds)), None
    worlds, images, actions = [], [], []
    while len(active):
        seen = {name: obs[name][active] for name in names}
        chosen, state = policy.predict(seen, state, deterministic=deterministic)
        worlds.append(active)
        images.append(seen["image"])
        actions.append(chosen)
        every = np.zeros(venv.num_envs, dtype=np.int64)
        every[active] = chosen
        obs, rewards, dones, infos = venv.step(every)
        returns[active] += rewards[active]
        ended = active[dones[active]]
        succeeded[ended] = [infos[world].get("is_success", returns[world] > 0) for world in ended]
        goes_on = ~dones[active]
        on_progress(len(ended))
        active = active[goes_on]
        if "mission" in names and (obs["mission"][active] != missions[active]).any():
            raise ValueError(MISSION_CHANGED)
        state = None if state is None else tuple(part[:, goes_on] for part in state)
    order = np.argsort(np.concatenate(worlds), kind="stable")  # by episode, then by time
    lengths = np.bincount(np.concatenate(worlds))
    return Episodes(
        images=np.concatenate(images)[order],
        actions=np.concatenate(actions)[order].astype(np.uint8 if venv.action_space.n <= 256 else np.int64),
        missions=missions,
        offsets=np.concatenate([[0], lengths.cumsum()]),
        returns=returns,
        seeds=seeds,
        succeeded=None if np.array_equal(succeeded, returns > 0) else succeeded,
    )


def check_sees(policy: BasePolicy, shown: spaces.Space, level: str) -> list[str]:
    """
    :param policy: that is to play
    :param shown: what the environment shows
    :param level: its name
    :return: what of it the policy looks at
    :raises ValueError: if that is not all there, or of another form
    """
    wanted = policy.observation_space
    assert isinstance(shown, spaces.Dict)
    if not isinstance(wanted, spaces.Dict) or any(shown.spaces.get(name) != space for name, space in wanted.spaces.items()):
        raise ValueError(f"the agent's observation space is not {level}'s: {wanted}, {shown}")
    return list(wanted.spaces)
