"""A level as a Gymnasium env."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from sb3_guide.envs.batch import Batch, Observation
from sb3_guide.envs.levels import level_of
from sb3_guide.envs.rendering import Window, checked_render_mode
from sb3_guide.envs.spaces import DEFAULT_HISTORY, action_space, observation_space


class GuideGridEnv(gymnasium.Env[Observation, np.int64]):
    """
    One world of a level: a batch of one. It truncates its episodes itself, and `info["is_success"]` tells how they ended.

    :param level: name or id of the level
    :param history: how many images before the present one an observation holds
    :param render_mode: None, "rgb_array", or "human" (needs pygame)
    :raises ValueError: if the level or the render mode is unknown, or history is negative
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 10}  # noqa: RUF012  declared by gymnasium.Env

    def __init__(self, level: str, history: int = DEFAULT_HISTORY, render_mode: str | None = None) -> None:
        self.observation_space = observation_space(history)
        self.action_space = action_space()
        self.render_mode = checked_render_mode(render_mode)
        self.level = level_of(level)
        self.history = history
        self._batch = Batch(self.level, 1, history)
        self._window: Window | None = None

    @property
    def mission(self) -> str:
        """The mission as text, "" before the first reset."""
        return self._batch.mission(0)

    def set_level(self, level: str) -> None:
        """
        Change the level from the next reset on, which must come before the next step.

        :param level: name or id of the level
        :raises ValueError: if the level is unknown
        """
        self.level = level_of(level)
        self._batch.set_level(self.level)

    @property
    def agent_pos(self) -> tuple[int, int]:
        """Column and row of the agent's cell, as Minigrid counts them."""
        return self._batch.place(0)[:2]

    @property
    def agent_dir(self) -> int:
        """Where the agent looks: 0 right, 1 down, 2 left, 3 up."""
        return self._batch.place(0)[2]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, dict[str, Any]]:
        """
        Begin an episode.

        :param seed: of this and all later episodes; None goes on with the random stream
        :param options: not used
        :return: observation and an empty info
        :raises ValueError: if the seed is negative
        """
        if seed is not None and seed < 0:
            raise ValueError(f"seed={seed}: expected a non-negative integer")
        super().reset(seed=seed)
        self._batch.set_generator(0, self.np_random)
        observation = self._batch.reset()
        self.np_random.bit_generator.state = self._batch.generator(0).bit_generator.state
        self._show()
        return self._single(observation), {}

    def step(self, action: np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """
        Act.

        :param action: number of the action in `ACTIONS`
        :return: observation, reward, terminated, truncated, info
        :raises ValueError: if the action is not valid, or the env was never reset
        """
        observation, rewards, *ends = self._batch.step(np.atleast_1d(action), go_on=False)
        terminated, truncated = (bool(end[0]) for end in ends)
        self._show()
        info = {"is_success": terminated} if terminated or truncated else {}
        return self._single(observation), float(rewards[0]), terminated, truncated, info

    def render(self) -> Any:
        """
        Draw the grid, the agent's view highlighted.

        :return: (height, width, 3) uint8 in mode "rgb_array", else None
        """
        if self.render_mode == "rgb_array":
            return self._batch.picture(0)
        self._show()
        return None

    def close(self) -> None:
        """Close the window of mode "human"."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def get_state(self) -> dict[str, np.ndarray]:
        """:return: the exact state of the world and its random stream, as of `GuideGridVecEnv.get_state`"""
        self._batch.set_generator(0, self.np_random)
        return self._batch.get_state()

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """
        Take over a state of `get_state`.

        :param state: arrays of a batch of one
        :raises ValueError: if the state is of another history or not a state at all
        """
        self._batch.set_state(state)
        self.np_random = self._batch.generator(0)

    def _single(self, observation: Observation) -> Observation:
        return {name: values[0] for name, values in observation.items()}

    def _show(self) -> None:
        if self.render_mode == "human":
            self._window = self._window or Window(self.metadata["render_fps"])
            self._window.show(self._batch.picture(0), self.mission)
