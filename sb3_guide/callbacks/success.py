"""Success rate of the episodes that training finishes."""

from collections import deque
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback


class EpisodeSuccesses(BaseCallback):
    """
    Remember whether the last episodes succeeded. An episode succeeds where its last ``info`` says ``is_success``. Another
    training, of another model or from frame 0 on, is not judged by what was before.

    :param verbose: as in SB3
    """

    def __init__(self, verbose: int = 0) -> None:
        super().__init__(verbose)
        self.successes: deque[bool] = deque()
        self.owner: BaseAlgorithm | None = None  # whose successes these are

    @property
    def n_episodes(self) -> int:
        """How many episodes are remembered."""
        raise NotImplementedError

    def enough(self, success_rate: float) -> bool:
        """:return: whether as many episodes as are remembered have been played, and so many of them succeeded"""
        return len(self.successes) == self.n_episodes and sum(self.successes) >= success_rate * self.n_episodes

    def _init_callback(self) -> None:
        if self.model is not self.owner:
            self.owner = self.model
            self._forget()

    def _on_training_start(self) -> None:
        if self.model.num_timesteps == 0:
            self._forget()

    def _forget(self) -> None:
        """Be as if no training had been."""
        self.successes = deque(maxlen=self.n_episodes)

    def _on_step(self) -> bool:
        for world in np.flatnonzero(self.locals["dones"]):
            success = self.locals["infos"][world].get("is_success")
            if success is not None:
                self.successes.append(bool(success))
        return True

    def get_state(self) -> dict[str, Any]:
        """:return: what a training that goes on later needs of it, as plain values"""
        return {"successes": list(self.successes)}

    def set_state(self, state: dict[str, Any]) -> None:
        """
        :param state: of :meth:`get_state`; the callback knows its model already
        """
        self.successes.clear()
        self.successes.extend(state["successes"])


class SuccessRateCallback(EpisodeSuccesses):
    """
    Log ``rollout/success_rate``: the share of successful episodes among the last ones, as many as SB3 averages its other
    statistics over (``stats_window_size``).

    :param verbose: as in SB3
    """

    @property
    def n_episodes(self) -> int:
        return self.model._stats_window_size

    def _on_rollout_end(self) -> None:
        if self.successes:
            self.logger.record("rollout/success_rate", float(np.mean(self.successes)))


class StopTrainingOnSuccessRate(EpisodeSuccesses):
    """
    Stop the training once enough of the last episodes succeeded. Those are played as the training plays them, with sampled
    actions.

    :param success_rate: that is enough, above 0 and at most 1
    :param n_episodes: that must have been played since the training began, and over which the rate is taken
    :param verbose: 1 to tell when the training stops
    :raises ValueError: if a number is out of range
    """

    def __init__(self, success_rate: float, n_episodes: int = 1000, verbose: int = 0) -> None:
        super().__init__(verbose)
        if not 0 < success_rate <= 1:
            raise ValueError(f"success_rate={success_rate}: expected a number above 0 and at most 1")
        if n_episodes < 1:
            raise ValueError(f"n_episodes={n_episodes}: expected at least 1")
        self.success_rate = success_rate
        self._n_episodes = n_episodes

    @property
    def n_episodes(self) -> int:
        return self._n_episodes

    def _on_step(self) -> bool:
        super()._on_step()
        reached = self.enough(self.success_rate)
        if reached and self.verbose:
            print(f"Stopping training: {sum(self.successes)} of the last {self.n_episodes} episodes succeeded")
        return not reached
