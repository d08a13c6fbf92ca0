"""Success rate of the episodes that training finishes."""

from collections import deque

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback


class SuccessRateCallback(BaseCallback):
    """
    Log ``rollout/success_rate``: the share of successful episodes among the last ones, as many as SB3 averages its other
    statistics over (``stats_window_size``). An episode succeeds where its last ``info`` says ``is_success``.

    :param verbose: as in SB3
    """

    def __init__(self, verbose: int = 0) -> None:
        super().__init__(verbose)
        self.successes: deque[bool] = deque()

    def _init_callback(self) -> None:
        self.successes = deque(self.successes, maxlen=self.model._stats_window_size)

    def _on_step(self) -> bool:
        for world in np.flatnonzero(self.locals["dones"]):
            success = self.locals["infos"][world].get("is_success")
            if success is not None:
                self.successes.append(bool(success))
        return True

    def _on_rollout_end(self) -> None:
        if self.successes:
            self.logger.record("rollout/success_rate", float(np.mean(self.successes)))
