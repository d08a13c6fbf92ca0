"""What a training logs."""

from typing import Any

from stable_baselines3.common.logger import KVWriter, Logger
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm


class Recorder(KVWriter):
    """Logger output that keeps everything: a dict a dump."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        self.rows.append(dict(key_values))

    def close(self) -> None:
        pass


def learn_and_log(model: OnPolicyAlgorithm, total_timesteps: int, callback: Any, **kwargs: Any) -> list[dict[str, Any]]:
    """The rows that a training logs, one a rollout."""
    recorder = Recorder()
    model.set_logger(Logger(None, [recorder]))
    model.learn(total_timesteps, callback=callback, log_interval=1, **kwargs)
    return recorder.rows
