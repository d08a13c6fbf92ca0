"""Behavioural cloning of whole episodes with imitation's BC."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch as th
from imitation.algorithms import bc
from imitation.data.types import DictObs
from imitation.util import logger as imitation_logger
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from stable_baselines3.common.distributions import Distribution

from sb3_guide.cloning.demonstrations import Demonstrations, check_space
from sb3_guide.cloning.episodes import Episodes
from sb3_guide.policies import AgentPolicy
from sb3_guide.policies.memory import scene_of
from sb3_guide.policies.products import check_arithmetic, computing_in, usual_arithmetic
from sb3_guide.policies.sequences import Sequences, padded


class EpisodeLoader:
    """
    Batches for BC, in which a row is an episode, padded at its end to the longest of the batch. The order of the episodes is
    a function of seed and epoch. Episodes that fill no batch wait for another epoch, where chance decides anew.

    :param episodes: to be cloned
    :param batch_size: episodes in a batch
    :param seed: of the order
    :raises ValueError: if there are fewer episodes than a batch needs
    """

    def __init__(self, episodes: Episodes, batch_size: int, seed: int) -> None:
        if not 1 <= batch_size <= len(episodes):
            raise ValueError(f"batch_size={batch_size}: expected 1 to {len(episodes)}, the number of demonstrations")
        self.episodes = episodes
        self.batch_size = batch_size
        self.seed = seed
        self.epoch = 0  # the one that is read next

    def __len__(self) -> int:
        """:return: batches in an epoch"""
        return len(self.episodes) // self.batch_size

    def __iter__(self) -> Iterator[dict[str, Any]]:
        order = np.random.default_rng([self.seed, self.epoch]).permutation(len(self.episodes))
        for start in range(0, len(order) - self.batch_size + 1, self.batch_size):
            yield self._batch(self.episodes.select(order[start : start + self.batch_size]))
        self.epoch += 1

    def _batch(self, chosen: Episodes) -> dict[str, Any]:
        """:return: images (B, T, ...), missions (B, words), lengths (B,) and actions (B, T) of B episodes"""
        valid = np.arange(chosen.lengths.max()) < chosen.lengths[:, None]  # (B, T)
        images = np.zeros((*valid.shape, *chosen.images.shape[1:]), dtype=chosen.images.dtype)
        actions = np.zeros(valid.shape, dtype=np.int64)
        images[valid] = chosen.images
        actions[valid] = chosen.actions
        return {"obs": DictObs({"image": images, "mission": chosen.missions, "length": chosen.lengths}), "acts": actions}


@dataclass(frozen=True)
class EpisodeLoss:
    """
    BC's loss over whole episodes: the mean over frames of the negative log-likelihood, less the weighted entropy. Memory
    starts from nothing at the start of each episode and gradients go back all the way. Messages are sampled.

    :param ent_weight: weight of the entropy of the actions
    :param generator: of the messages' noise
    :param arithmetic: of large matrix products, "float32" or "bfloat16"
    """

    ent_weight: float
    generator: th.Generator
    arithmetic: str

    def __call__(
        self, policy: RecurrentActorCriticPolicy, obs: Mapping[str, th.Tensor], acts: th.Tensor
    ) -> bc.BCTrainingMetrics:
        """
        :param policy: with carried memory
        :param obs: "image" (B, T, ...), "mission" (B, words) and "length" (B,)
        :param acts: (B, T)
        """
        valid = th.arange(acts.shape[1], device=acts.device) < obs["length"].unsqueeze(1)
        sequences = Sequences(obs["image"][valid], obs["mission"], obs["length"])
        with computing_in(self.arithmetic):
            distribution = distribution_along(policy, sequences, valid, self.generator)
        log_prob, entropy = distribution.log_prob(acts[valid]), distribution.entropy()
        assert entropy is not None  # of a categorical distribution
        neglogp, mean_entropy = -log_prob.mean(), entropy.mean()
        none = acts.new_zeros(())
        return bc.BCTrainingMetrics(
            neglogp=neglogp,
            entropy=mean_entropy,
            ent_loss=-self.ent_weight * mean_entropy,
            prob_true_act=log_prob.exp().mean(),
            l2_norm=none,
            l2_loss=none,
            loss=neglogp - self.ent_weight * mean_entropy,
        )


def distribution_along(
    policy: RecurrentActorCriticPolicy, sequences: Sequences, valid: th.Tensor, generator: th.Generator
) -> Distribution:
    """
    :param policy: ours, or any other of sb3-contrib's recurrent policies
    :param sequences: B whole episodes of K frames in all
    :param valid: (B, T) where there is a frame
    :param generator: of the messages' noise
    :return: distribution of the actions at the K frames
    """
    if isinstance(policy, AgentPolicy):
        memory = policy.network.remember(sequences)
        scene = scene_of(memory, sequences.lengths)
        return policy.action_distribution(policy.network.latent(memory, scene, generator))
    seen = {"image": sequences.images, "mission": sequences.missions.repeat_interleave(sequences.lengths, dim=0)}
    known = policy.observation_space.spaces  # type: ignore[attr-defined]
    features = policy.extract_features({name: seen[name] for name in known})  # type: ignore[arg-type]
    of_actor = features if policy.share_features_extractor else features[0]  # (K, features_dim)
    output, _ = policy.lstm_actor(padded(of_actor, valid).transpose(0, 1))  # from nothing: (T, B, hidden)
    return policy._get_action_dist_from_latent(policy.mlp_extractor.forward_actor(output.transpose(0, 1)[valid]))


def episode_bc(
    policy: RecurrentActorCriticPolicy,
    demonstrations: Demonstrations,
    *,
    batch_size: int,
    learning_rate: float,
    ent_weight: float,
    seed: int,
    arithmetic: str | None = None,
    logger: imitation_logger.HierarchicalLogger | None = None,
) -> tuple[bc.BC, EpisodeLoader]:
    """
    imitation's BC, set up to clone whole episodes (paper section 3.3).

    :param policy: with carried memory, one of ours or any of sb3-contrib's recurrent ones; it is trained in place
    :param demonstrations: of a level with the policy's observation space
    :param batch_size: episodes in a batch
    :param learning_rate: of Adam, whose other settings are the paper's (Table A.2)
    :param ent_weight: weight of the entropy of the actions
    :param seed: of the order of the episodes and of the messages' noise
    :param arithmetic: of large matrix products, "float32" or "bfloat16"; None takes bfloat16 where the policy is on a CPU that
        has units for it, and float32 elsewhere
    :param logger: imitation's; None makes a new one
    :return: the algorithm and its loader, which counts its epochs
    :raises ValueError: if the demonstrations are of another observation space or fewer than a batch, the memory is a window,
        or the arithmetic is unknown
    """
    arithmetic = usual_arithmetic(policy.device) if arithmetic is None else arithmetic
    check_arithmetic(arithmetic)
    if isinstance(policy, AgentPolicy) and not policy.carries_memory:
        raise ValueError(
            f"{type(policy).__name__} remembers windows: expected Recurrent{type(policy).__name__} to clone episodes"
        )
    if not isinstance(policy, RecurrentActorCriticPolicy):
        raise ValueError(f"{type(policy).__name__} has no memory: expected a recurrent policy, ours or sb3-contrib's")
    check_space(demonstrations, policy.observation_space)  # type: ignore[arg-type]
    loader = EpisodeLoader(demonstrations.episodes, batch_size, seed)
    fused = True if policy.device.type == "cpu" else None  # as torch chooses
    algorithm = bc.BC(
        observation_space=policy.observation_space,
        action_space=policy.action_space,
        rng=np.random.default_rng(seed),
        policy=policy,
        demonstrations=loader,
        batch_size=batch_size,
        optimizer_kwargs={"lr": learning_rate, "eps": 1e-5, "fused": fused},
        device=policy.device,
        custom_logger=logger,
    )
    algorithm.loss_calculator = EpisodeLoss(ent_weight, th.Generator().manual_seed(seed), arithmetic)
    policy.set_training_mode(True)
    return algorithm, loader
