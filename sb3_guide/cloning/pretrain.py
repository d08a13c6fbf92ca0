"""Cloning as the first part of a training by SB3: the model goes on, and so does its log."""

from imitation.util.logger import HierarchicalLogger
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.utils import configure_logger

from sb3_guide.cloning.bc import episode_bc
from sb3_guide.cloning.demonstrations import Demonstrations


def pretrain(
    model: OnPolicyAlgorithm,
    demonstrations: Demonstrations,
    *,
    n_epochs: int,
    batch_size: int = 32,
    learning_rate: float = 1e-3,
    ent_weight: float = 0.01,
    seed: int = 0,
    arithmetic: str | None = None,
) -> None:
    """
    Clone demonstrations into a model of sb3-contrib's RecurrentPPO; ``model.learn`` then goes on from there. Its logger, the
    one of ``model.set_logger`` if there is one, gets imitation's ``bc/...`` first and SB3's own after. The model's optimiser
    is left alone, as imitation has one of its own. The critic learns nothing: begin with small steps, else its first guesses
    may undo what was cloned.

    :param model: in an environment made with ``history=0``
    :param demonstrations: of its level
    :param n_epochs: passes through them
    :param batch_size: episodes in a batch
    :param learning_rate: of imitation's Adam
    :param ent_weight: weight of the entropy of the actions
    :param seed: of the order of the episodes and of messages
    :param arithmetic: see :func:`~sb3_guide.cloning.bc.episode_bc`
    :raises ValueError: if the policy has no memory, the demonstrations are of another observation space or too
        few, or the arithmetic is unknown
    """
    if not hasattr(model, "_logger"):
        model.set_logger(configure_logger(model.verbose, model.tensorboard_log, type(model).__name__))
    algorithm, loader = episode_bc(
        model.policy,  # type: ignore[arg-type]  # which complains of what it can't clone
        demonstrations,
        batch_size=batch_size,
        learning_rate=learning_rate,
        ent_weight=ent_weight,
        seed=seed,
        arithmetic=arithmetic,
        logger=HierarchicalLogger(model.logger),
    )
    algorithm.train(n_epochs=n_epochs, progress_bar=False, log_interval=len(loader))
