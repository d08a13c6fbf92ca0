"""Many worlds of a level as Gymnasium's own VectorEnv, for `gymnasium.make_vec`. Needs Gymnasium 1.1."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv  # type: ignore[attr-defined]
from gymnasium.vector.utils import batch_space

from sb3_guide.envs.batch import Batch, Observation
from sb3_guide.envs.levels import level_of
from sb3_guide.envs.rendering import checked_render_mode
from sb3_guide.envs.spaces import DEFAULT_HISTORY, action_space, observation_space


class GuideGridVectorEnv(VectorEnv):
    """
    Worlds of one level that step together in compiled code; a world whose episode ends begins a new one in the same step.

    :param level: name or id of the level
    :param num_envs: how many worlds
    :param history: how many images before the present one an observation holds
    :param render_mode: None or "rgb_array"
    :param n_threads: how many threads share a step's work; results do not depend on it
    :raises ValueError: if the level or the render mode is unknown, or a number is out of range
    """

    metadata = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012  as VectorEnv declares

    def __init__(
        self,
        level: str,
        num_envs: int = 1,
        history: int = DEFAULT_HISTORY,
        render_mode: str | None = None,
        n_threads: int = 1,
    ) -> None:
        if render_mode == "human":
            raise ValueError("render_mode='human' shows one world: expected None or 'rgb_array'")
        self._batch = Batch(level_of(level), num_envs, history, n_threads)
        self.num_envs = num_envs
        self.render_mode = checked_render_mode(render_mode)
        self.single_observation_space = observation_space(history)
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """
        Begin new episodes in all worlds.

        :param seed: one for each world, or one number to which world i adds i; None goes on with the random streams
        :param options: not used; worlds cannot be reset one by one
        :return: the observations and an empty info
        :raises ValueError: if the seeds are not valid, or the options ask for some of the worlds only
        """
        if options and "reset_mask" in options:
            raise ValueError("options['reset_mask']: worlds are reset in the step that ends their episodes, not one by one")
        seeds = seed if isinstance(seed, Sequence) else [None if seed is None else seed + i for i in range(self.num_envs)]
        self._batch.seed(seeds)
        return self._batch.reset(), {}

    def step(  # type: ignore[override]  # in Gymnasium 0.29, a VectorEnv is an Env
        self, actions: np.ndarray
    ) -> tuple[Observation, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """
        Act, and begin new episodes where the old ones ended.

        :param actions: (num_envs,) numbers of the actions in `ACTIONS`
        :return: observations, (num_envs,) float64 rewards, (num_envs,) bool terminated and truncated, infos; where an
            episode ended, infos["final_obs"] and infos["final_info"] tell how
        :raises ValueError: if the actions are not valid, or the env was never reset
        """
        observations, rewards, terminated, truncated = self._batch.step(actions, go_on=True)
        ended = terminated | truncated
        infos: dict[str, Any] = {}
        if ended.any():
            last = np.full(self.num_envs, None, dtype=object)
            last[ended] = self._batch.last_observations(np.flatnonzero(ended))
            infos = {"final_obs": last, "final_info": {"is_success": terminated.copy(), "_is_success": ended.copy()}}
            infos |= {"_final_obs": ended.copy(), "_final_info": ended.copy()}
        return observations, rewards, terminated, truncated, infos

    def render(self) -> tuple[np.ndarray, ...] | None:  # type: ignore[override]
        """:return: a frame (height, width, 3) uint8 of every world in mode "rgb_array", else None"""
        if self.render_mode is None:
            return None
        return tuple(self._batch.picture(index) for index in range(self.num_envs))
