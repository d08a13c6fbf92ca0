"""Rollouts as callbacks count them."""

from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm


def is_due(callback: BaseCallback, every_n_rollouts: int) -> bool:
    """
    :param callback: at the end of a rollout
    :param every_n_rollouts: in so many of which one is meant, counted from frame 0 on, so that a training that was resumed
        counts as if it had not been stopped
    :return: whether it is this one
    """
    assert isinstance(callback.model, OnPolicyAlgorithm)
    rollout = callback.num_timesteps // (callback.model.n_steps * callback.model.n_envs)
    return rollout % every_n_rollouts == 0
