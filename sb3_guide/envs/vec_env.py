"""Many worlds of a level as a native Stable-Baselines3 VecEnv."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from sb3_guide.envs.batch import Batch, Observation
from sb3_guide.envs.env import GuideGridEnv
from sb3_guide.envs.levels import Level, level_of
from sb3_guide.envs.rendering import checked_render_mode
from sb3_guide.envs.seeding import HIGHEST_SEED
from sb3_guide.envs.spaces import DEFAULT_HISTORY, action_space, observation_space


class WorldView:
    """
    One world of a VecEnv, as `get_attr`, `set_attr` and `env_method` see it.

    :param batch: the worlds
    :param index: which of them
    :param render_mode: of the VecEnv
    """

    def __init__(self, batch: Batch, index: int, render_mode: str | None) -> None:
        self._batch = batch
        self._index = index
        self.render_mode = render_mode

    @property
    def observation_space(self) -> spaces.Dict:
        """The space of the world's observations."""
        return observation_space(self._batch.history)

    @property
    def action_space(self) -> spaces.Discrete:
        """The space of the actions."""
        return action_space()

    @property
    def spec(self) -> EnvSpec:
        """How Gymnasium makes such a world."""
        return gymnasium.spec(self._batch.level.env_id)

    @property
    def unwrapped(self) -> WorldView:
        """The view itself: there are no wrappers."""
        return self

    @property
    def level(self) -> Level:
        """The level."""
        return self._batch.level

    def set_level(self, level: str) -> None:
        """
        Change the level of all worlds, which have one together, from the next reset on, which must come before the next step.

        :param level: name or id of the level
        :raises ValueError: if the level is unknown
        """
        self._batch.set_level(level_of(level))

    @property
    def history(self) -> int:
        """How many images before the present one an observation holds."""
        return self._batch.history

    @property
    def mission(self) -> str:
        """The mission as text."""
        return self._batch.mission(self._index)

    @property
    def np_random(self) -> np.random.Generator:
        """A copy of the world's generator; assign one to change the world's random stream."""
        return self._batch.generator(self._index)

    @np_random.setter
    def np_random(self, generator: np.random.Generator) -> None:
        self._batch.set_generator(self._index, generator)

    def render(self) -> np.ndarray:
        """:return: (height, width, 3) uint8, the grid with the agent's view highlighted"""
        return self._batch.picture(self._index)


class GuideGridVecEnv(VecEnv):
    """
    Worlds of one level that step together in compiled code. Arrays that a step returns are never rewritten by a later one.

    :param env_id: id or name of the level
    :param n_envs: how many worlds
    :param seed: world i has the random stream of seed + i, from the first reset on; None takes entropy from the system
    :param history: how many images before the present one an observation holds
    :param render_mode: None or "rgb_array"
    :param n_threads: how many threads share a step's work; results do not depend on it
    :raises ValueError: if the level is unknown or a number is out of range
    """

    def __init__(
        self,
        env_id: str,
        n_envs: int,
        seed: int | None = None,
        history: int = DEFAULT_HISTORY,
        render_mode: str | None = None,
        n_threads: int = 1,
    ) -> None:
        if render_mode == "human":
            raise ValueError(
                "render_mode='human' shows one world: expected None or 'rgb_array'; SB3's render('human') shows all"
            )
        self._batch = Batch(level_of(env_id), n_envs, history, n_threads)
        self._views = [WorldView(self._batch, index, checked_render_mode(render_mode)) for index in range(n_envs)]
        self._actions = np.zeros(n_envs, dtype=np.int64)
        super().__init__(n_envs, observation_space(history), action_space())
        if seed is not None:
            self.seed(seed)

    @classmethod
    def from_env_fns(cls, env_fns: Sequence[Callable[[], gymnasium.Env]], n_threads: int = 1) -> VecEnv:
        """
        Serve as `vec_env_cls` in SB3's `make_vec_env`.

        :param env_fns: each makes a GuideGrid env of the same level, history and render mode, at most within a Monitor
        :param n_threads: see :class:`GuideGridVecEnv`
        :return: one VecEnv of as many worlds, within a VecMonitor if the envs have Monitors
        :raises ValueError: if they are not alike, or another wrapper, or what a Monitor writes, would get lost
        """
        envs = [make() for make in env_fns]
        if not envs:
            raise ValueError("env_fns is empty: expected at least one function that makes an env")
        kinds = {_kind_of(env) for env in envs}
        for env in envs:
            env.close()
        if len(kinds) > 1:
            raise ValueError(
                f"env_fns make different envs {sorted(map(str, kinds))}: expected one level, history and render mode"
            )
        level, history, render_mode, monitored = kinds.pop()
        venv = cls(level, len(envs), history=history, render_mode=render_mode, n_threads=n_threads)
        return VecMonitor(venv) if monitored else venv

    @property
    def level(self) -> Level:
        """The level of all worlds."""
        return self._batch.level

    @property
    def missions(self) -> list[str]:
        """The missions of all worlds as text."""
        return [self._batch.mission(index) for index in range(self.num_envs)]

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """
        Choose the random streams for the next reset.

        :param seed: world i gets seed + i; None chooses at random
        :return: the worlds' seeds
        :raises ValueError: if the seed is negative or has more than 64 bits
        """
        if seed is not None and not 0 <= seed <= HIGHEST_SEED - self.num_envs:
            raise ValueError(f"seed={seed}: expected a non-negative integer of at most 64 bits")
        return super().seed(seed)

    def reset(self) -> Observation:
        """
        Begin new episodes in all worlds.

        :return: the observations
        """
        self._batch.seed(self._seeds)
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return self._batch.reset()

    def reset_to(self, seeds: np.ndarray) -> Observation:
        """
        Begin a new episode in every world, with a seed for each.

        :param seeds: (n_envs,) int64, as for the seed of a Gymnasium env
        :return: the observations
        :raises ValueError: if there is not one non-negative integer for every world
        """
        seeds = np.asarray(seeds)
        if seeds.shape != (self.num_envs,) or not np.issubdtype(seeds.dtype, np.integer) or (seeds < 0).any():
            raise ValueError(f"seeds={seeds}: expected ({self.num_envs},) non-negative integers, one for every world")
        self._seeds = seeds.tolist()
        return self.reset()

    def step_async(self, actions: np.ndarray) -> None:
        """
        :param actions: (n_envs,) numbers of the actions in `ACTIONS`
        """
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """
        Act, and begin new episodes where the old ones ended.

        :return: observations, (n_envs,) float32 rewards, (n_envs,) bool dones, infos
        :raises ValueError: if the actions are not valid, or the env was never reset
        """
        observations, rewards, terminated, truncated = self._batch.step(self._actions, go_on=True)
        dones = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        ended = np.flatnonzero(dones)
        last = self._batch.last_observations(ended) if len(ended) else []
        for place, success, observation in zip(ended.tolist(), terminated[ended].tolist(), last, strict=True):
            infos[place] = {"terminal_observation": observation, "TimeLimit.truncated": not success, "is_success": success}
        return observations, rewards.astype(np.float32), dones, infos

    def get_state(self) -> dict[str, np.ndarray]:
        """:return: copies of the exact state of all worlds and their random streams, by name; arrays are (n_envs, ...)"""
        return self._batch.get_state()

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """
        Take over a state of `get_state`. Observations of the present are not part of it: step or reset next.

        :param state: arrays by name, of the same level, number of worlds and history
        :raises ValueError: if names, shapes, dtypes or values are not possible; the worlds are unchanged then
        """
        self._batch.set_state(state)
        self._reset_seeds()  # the state's random streams take the place of those chosen for the next reset

    def get_images(self) -> Sequence[np.ndarray | None]:
        """:return: a frame (height, width, 3) uint8 of every world in mode "rgb_array", else None"""
        return [view.render() if self.render_mode == "rgb_array" else None for view in self._views]

    def close(self) -> None:
        """Nothing is held open."""

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """:return: the attribute of the chosen worlds, such as "mission", "level", "np_random" """
        return [getattr(view, attr_name) for view in self._chosen(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the chosen worlds; assigning "np_random" changes their random streams."""
        for view in self._chosen(indices):
            setattr(view, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """:return: what the method returns for the chosen worlds, such as "render" or "set_level" """
        return [getattr(view, method_name)(*method_args, **method_kwargs) for view in self._chosen(indices)]

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """:return: False for the chosen worlds, which have no wrappers"""
        return [False for _ in self._chosen(indices)]

    def _chosen(self, indices: VecEnvIndices) -> list[WorldView]:
        return [self._views[index] for index in self._get_indices(indices)]


def _kind_of(env: gymnasium.Env) -> tuple[str, int, str | None, bool]:
    """:return: level, history and render mode of a GuideGrid env, and whether a Monitor is around it"""
    base = env.unwrapped
    if not isinstance(base, GuideGridEnv):
        raise ValueError(f"env_fns make a {type(base).__name__}: expected GuideGrid envs")
    monitored = False
    while isinstance(env, gymnasium.Wrapper):
        if not isinstance(env, (Monitor, OrderEnforcing, PassiveEnvChecker)):
            raise ValueError(f"the wrapper {type(env).__name__} cannot be kept: use a VecEnvWrapper instead")
        if isinstance(env, Monitor):
            if env.results_writer is not None or env.info_keywords:
                raise ValueError(
                    "what a Monitor writes cannot be kept: leave monitor_dir and info_keywords out, and use "
                    "VecMonitor(GuideGridVecEnv(...), filename, info_keywords)"
                )
            monitored = True
        env = env.env
    return base.level.name, base.history, base.render_mode, monitored
