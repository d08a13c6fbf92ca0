"""The same metrics from imitation's hooks."""

from collections.abc import Callable

import numpy as np
import torch as th
from stable_baselines3.common.logger import Logger

from sb3_guide.callbacks.communication import measure_communication
from sb3_guide.cloning import Demonstrations, play
from sb3_guide.policies import AgentPolicy
from sb3_guide.policies.networks import GuideNetwork


class EpochMetrics:
    """
    Validate an agent after each epoch of ``BC.train(on_epoch_end=...)``: success rate on the same missions each time, with
    the most probable actions and messages; loss and, for an agent with a channel, CIC along demonstrations (paper
    sections 4.1 and 5.3).

    :param policy: that is cloned, with carried memory
    :param seeds: (E,) of the missions, none of which the agent is trained on
    :param demonstrations: for loss and CIC, none of which the agent is trained on
    :param logger: SB3's or imitation's, for ``rollout/success_rate`` and ``guide/cic``; None logs nothing
    :param on_epoch: called with each epoch's row after it was added to ``history``
    """

    def __init__(
        self,
        policy: AgentPolicy,
        seeds: np.ndarray,
        demonstrations: Demonstrations,
        logger: Logger | None = None,
        on_epoch: Callable[[dict[str, float]], object] = lambda row: None,
    ) -> None:
        self.policy = policy
        self.seeds = seeds
        self.demonstrations = demonstrations
        self.logger = logger
        self.on_epoch = on_epoch
        self.history: list[dict[str, float]] = []

    def __call__(self) -> None:
        row = {"epoch": float(len(self.history) + 1), **self.play(), **self.follow()}
        self.history.append(row)
        self.policy.set_training_mode(True)
        if self.logger is not None:
            self.logger.record("rollout/success_rate", row["success_rate"])
            for name in ("cic", "uniform_cic", "message_entropy"):
                if name in row:
                    self.logger.record(f"guide/{name}", row[name])
        self.on_epoch(row)

    def play(self) -> dict[str, float]:
        """:return: "success_rate" and "mean_length" on the missions"""
        episodes = play(self.policy, self.demonstrations.level, self.seeds)
        return {"success_rate": float(episodes.successes.mean()), "mean_length": float(episodes.lengths.mean())}

    def follow(self) -> dict[str, float]:
        """:return: "loss", the negative log-likelihood a frame, and measures of communication, along the demonstrations"""
        network = self.policy.network
        with th.no_grad():
            memory = network.remember(self.demonstrations.episodes.sequences())
            distribution = self.policy.action_distribution(network.latent(memory))
            loss = -distribution.log_prob(th.as_tensor(self.demonstrations.episodes.actions)).mean().item()
        communication = measure_communication(self.policy, memory) if isinstance(network, GuideNetwork) else {}
        return {"loss": loss, **communication}
