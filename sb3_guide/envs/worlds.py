"""Environments by their ids, ours and all others that Gymnasium knows, each world with a seed of its own."""

from __future__ import annotations

import enum
from contextlib import closing
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from stable_baselines3.common.preprocessing import is_image_space, is_image_space_channels_first
from stable_baselines3.common.vec_env import VecTransposeImage

from sb3_guide.envs.batch import Observation
from sb3_guide.envs.levels import LEVELS, level_of
from sb3_guide.envs.spaces import ACTIONS, action_space, observation_space
from sb3_guide.envs.vec_env import GuideGridVecEnv


class Worlds:
    """
    Environments side by side: as much of SB3's ``VecEnv`` as playing missions needs, and they can rest.

    :param env_id: of an environment that observes a Dict with "image"
    :param n_envs: how many
    :param go_on: begin a new episode where one ends; else that environment rests until the next ``reset_to``
    :raises ValueError: if it observes something else, or its actions are not Discrete
    """

    def __init__(self, env_id: str, n_envs: int, go_on: bool) -> None:
        self.num_envs = n_envs
        self._envs = [gymnasium.make(env_id) for _ in range(n_envs)]
        seen = self._envs[0].observation_space
        if not isinstance(seen, spaces.Dict) or not isinstance(seen.spaces.get("image"), spaces.Box):
            raise ValueError(f"{env_id} observes {seen}: expected a Dict with 'image' and, if there are missions, 'mission'")
        self.observation_space = spaces.Dict({name: _turned(space) for name, space in seen.spaces.items()})
        self.action_space = _discrete(self._envs[0].action_space)
        self._turns = [name for name, space in seen.spaces.items() if space.shape != self.observation_space[name].shape]
        self._go_on = go_on
        self._latest: list[Observation] = []
        self._rests = np.zeros(n_envs, dtype=np.bool_)

    def reset_to(self, seeds: np.ndarray) -> Observation:
        """
        Begin a new episode in every world.

        :param seeds: (n_envs,) a seed for each
        :return: the observations
        """
        self._latest = [env.reset(seed=int(seed))[0] for env, seed in zip(self._envs, seeds, strict=True)]
        self._rests[:] = False
        return self._observation()

    def step(self, actions: np.ndarray) -> tuple[Observation, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """
        :param actions: (n_envs,) of which those of worlds at rest are ignored
        :return: observations, rewards, dones and infos as a ``VecEnv`` has them; a world at rest shows what it showed last
        """
        rewards, infos = np.zeros(len(self._envs)), [dict[str, Any]() for _ in self._envs]
        for index in np.flatnonzero(~self._rests):
            obs, rewards[index], terminated, truncated, infos[index] = self._envs[index].step(actions[index])
            self._latest[index], self._rests[index] = obs, terminated or truncated
        dones = self._rests.copy()
        if self._go_on:
            for index in np.flatnonzero(dones):
                self._latest[index] = self._envs[index].reset()[0]
            self._rests[:] = False
        return self._observation(), rewards, dones, infos

    def close(self) -> None:
        """Close all of them."""
        for env in self._envs:
            env.close()

    def _observation(self) -> Observation:
        stacked = {name: np.stack([obs[name] for obs in self._latest]) for name in self.observation_space.spaces}
        return {name: np.moveaxis(part, -1, 1) if name in self._turns else part for name, part in stacked.items()}


def _turned(space: spaces.Space) -> spaces.Space:
    """:return: the space as SB3's algorithms show it to a policy: channels first, of what they take for a picture"""
    if isinstance(space, spaces.Box) and is_image_space(space) and not is_image_space_channels_first(space):
        return VecTransposeImage.transpose_space(space)
    return space


def _discrete(space: spaces.Space) -> spaces.Discrete:
    if not isinstance(space, spaces.Discrete):
        raise ValueError(f"the actions are {space}: expected a Discrete space")
    return space


def is_level(name: str) -> bool:
    """:return: whether this is the name or the id of one of our levels"""
    return name in LEVELS or name in {level.env_id for level in LEVELS.values()}


def name_of(env_id: str) -> str:
    """
    :param env_id: name or id of a level, or id of another environment that is registered in Gymnasium
    :return: the level's name, or that id
    :raises ValueError: if there is neither
    """
    if is_level(env_id):
        return level_of(env_id).name
    if env_id not in gymnasium.registry:
        raise ValueError(
            f"unknown environment {env_id!r}: expected a level ({', '.join(LEVELS)}), or an id registered in Gymnasium "
            "(import the package that registers it first; on the command line, PACKAGE:ID does)"
        )
    return env_id


def worlds_of(env_id: str, n_envs: int, history: int = 0, go_on: bool = False) -> GuideGridVecEnv | Worlds:
    """
    :param env_id: see :func:`name_of`
    :param n_envs: how many worlds
    :param history: images before the present one that an observation of our levels holds; others have what they have
    :param go_on: begin a new episode where one ends, as our levels always do; others rest else
    :return: worlds with ``reset_to``, ``step``, ``close``, ``observation_space`` and ``action_space``
    :raises ValueError: if there is no such environment, or it shows no image
    """
    name = name_of(env_id)
    return GuideGridVecEnv(name, n_envs, history=history) if is_level(name) else Worlds(name, n_envs, go_on)


def spaces_of(env_id: str) -> tuple[spaces.Dict, spaces.Discrete]:
    """
    :param env_id: see :func:`name_of`
    :return: what a policy with carried memory observes there, which needs no "history", and what it can do
    :raises ValueError: if there is no such environment, or it shows no image
    """
    if is_level(name_of(env_id)):
        return observation_space(history=0), action_space()
    worlds = Worlds(env_id, 1, go_on=False)
    worlds.close()
    seen = {name: space for name, space in worlds.observation_space.spaces.items() if name != "history"}
    return spaces.Dict(seen), worlds.action_space


def action_names(env_id: str) -> tuple[str, ...]:
    """
    :param env_id: see :func:`name_of`
    :return: what its actions are called, by ``action_names`` of the environment or of a wrapper around it, or by an Enum
        ``actions`` such as Minigrid's; by their numbers where there is neither
    :raises ValueError: if there is no such environment
    """
    if is_level(name_of(env_id)):
        return ACTIONS
    with closing(gymnasium.make(env_id)) as env:
        count = int(_discrete(env.action_space).n)
        for attribute in ("action_names", "actions"):
            try:
                names = env.get_wrapper_attr(attribute)
            except AttributeError:
                continue
            found = tuple(name.name if isinstance(name, enum.Enum) else name for name in names)
            if len(found) == count and all(isinstance(name, str) for name in found):
                return found
    return tuple(map(str, range(count)))
