"""Policies and observations that no environment is needed for."""

import torch as th
from gymnasium import spaces

from sb3_guide.envs import observation_space
from sb3_guide.policies import AgentPolicy

HISTORY = 3


def make_policy(policy_class: type[AgentPolicy], history: int | None = None, **kwargs) -> AgentPolicy:
    """A policy with weights that depend on nothing but its arguments."""
    th.manual_seed(0)
    if history is None:
        history = 0 if policy_class.carries_memory else HISTORY
    return policy_class(observation_space(history), spaces.Discrete(7), lambda _: 1e-3, **kwargs)


def random_images(*shape: int, seed: int = 0) -> th.Tensor:
    """Images that differ from nothing at all in every cell."""
    return th.randint(1, 3, (*shape, 7, 7, 3), generator=th.Generator().manual_seed(seed), dtype=th.uint8)


def random_missions(n: int, seed: int = 0) -> th.Tensor:
    """Missions of different lengths."""
    generator = th.Generator().manual_seed(seed)
    missions = th.randint(1, 26, (n, 72), generator=generator, dtype=th.uint8)
    lengths = th.randint(2, 9, (n, 1), generator=generator)
    return missions * (th.arange(72) < lengths)
