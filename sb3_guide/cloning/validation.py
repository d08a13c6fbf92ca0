"""How an agent that is cloned does on missions and demonstrations that it is not trained on, for imitation's hooks."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import torch as th
from stable_baselines3.common.logger import Logger

from sb3_guide.cloning.demonstrations import Demonstrations
from sb3_guide.cloning.episodes import play
from sb3_guide.metrics import cic, message_entropy, tempered, uniform_cic
from sb3_guide.policies import AgentPolicy
from sb3_guide.policies.memory import scene_of


class Validation:
    """
    Validate an agent whenever it is called, such as after each epoch of ``BC.train(on_epoch_end=...)``: success rate on the
    same missions each time, with the most probable actions and messages; loss and, for an agent with a channel, CIC along
    demonstrations (paper sections 4.1 and 5.3). With several levels all numbers are means over them.

    :param policy: that is cloned, with carried memory
    :param seeds: (E,) of the missions of each level, none of which the agent is trained on
    :param demonstrations: of each level, for loss and CIC, none of which the agent is trained on
    :param logger: SB3's or imitation's, for ``rollout/success_rate`` and ``guide/cic``; None logs nothing
    :param on_row: called with each row after it was added to ``history``
    """

    def __init__(
        self,
        policy: AgentPolicy,
        seeds: np.ndarray,
        demonstrations: Sequence[Demonstrations],
        logger: Logger | None = None,
        on_row: Callable[[dict[str, float]], object] = lambda row: None,
    ) -> None:
        self.policy = policy
        self.seeds = seeds
        self.demonstrations = demonstrations
        self.logger = logger
        self.on_row = on_row
        self.history: list[dict[str, float]] = []

    def __call__(self) -> None:
        levels = [{**self.play(part.level), **self.follow(part)} for part in self.demonstrations]
        row = {name: float(np.mean([level[name] for level in levels])) for name in levels[0]}
        self.history.append(row)
        self.policy.set_training_mode(True)
        if self.logger is not None:
            self.logger.record("rollout/success_rate", row["success_rate"])
            for name in ("cic", "uniform_cic", "message_entropy", "tempered_cic"):
                if name in row:
                    self.logger.record(f"guide/{name}", row[name])
        self.on_row(row)

    def play(self, level: str) -> dict[str, float]:
        """:return: "success_rate" and "mean_length" on the missions of a level"""
        episodes = play(self.policy, level, self.seeds)
        return {"success_rate": float(episodes.successes.mean()), "mean_length": float(episodes.lengths.mean())}

    def follow(self, demonstrations: Demonstrations) -> dict[str, float]:
        """:return: "loss", the negative log-likelihood a frame, and measures of communication, along demonstrations"""
        network, episodes = self.policy.network, demonstrations.episodes
        sequences = episodes.sequences().to(self.policy.device)
        with th.no_grad():
            memory = network.remember(sequences)
            distribution = self.policy.action_distribution(network.latent(memory, scene_of(memory, sequences.lengths)))
            loss = -distribution.log_prob(th.as_tensor(episodes.actions, device=self.policy.device)).mean().item()
        communication = measure_communication(self.policy, memory) if self.policy.has_symbols else {}
        return {"loss": loss, **communication}


def measure_communication(policy: AgentPolicy, memory: th.Tensor) -> dict[str, float]:
    """
    The four numbers that belong together, averaged over frames.

    :param policy: with a channel
    :param memory: (K, state_size) of its network at K frames
    :return: in nats "cic", "uniform_cic", "message_entropy", and "tempered_cic": CIC of messages half as uncertain as can be
    :raises ValueError: if the policy has no channel, or a continuous one
    """
    at_once = policy.channel.encoder.shape.frames_at_once
    with th.no_grad():
        parts = memory.split(at_once)
        messages = th.cat([policy.channel.message_log_probs(part) for part in parts])
        uncertain = tempered(messages, math.log(messages.shape[1]) / 2)
        influences = []  # (frames, 3) of each part: enumerating actions of all frames would need too much memory
        for part, spoken, less_surely in zip(parts, messages.split(at_once), uncertain.split(at_once), strict=True):
            actions = policy.listen(part)
            influences.append(th.stack([cic(spoken, actions), uniform_cic(actions), cic(less_surely, actions)], dim=1))
    means = dict(zip(("cic", "uniform_cic", "tempered_cic"), th.cat(influences).mean(dim=0).cpu().tolist(), strict=True))
    return {**means, "message_entropy": message_entropy(messages).mean().item()}
