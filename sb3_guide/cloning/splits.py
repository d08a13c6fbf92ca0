"""Which missions are for what. No mission serves two purposes."""

import numpy as np

MISSIONS = 1_000_000_000  # in each split; reinforcement learning, which SB3 seeds, has the seeds below
FIRST_SEED = {"train": MISSIONS, "validation": 2 * MISSIONS, "analysis": 3 * MISSIONS}


def mission_seeds(split: str, n_episodes: int, skip: int = 0) -> np.ndarray:
    """
    :param split: "train", "validation" (curves) or "analysis" (everything that is reported of finished agents)
    :param n_episodes: how many
    :param skip: how many to leave out before them
    :return: (n_episodes,) int64
    :raises ValueError: if the split is unknown or there are not so many missions
    """
    if split not in FIRST_SEED:
        raise ValueError(f"split={split!r} is unknown: expected one of {', '.join(FIRST_SEED)}")
    if not 1 <= n_episodes <= MISSIONS - skip:
        raise ValueError(f"{n_episodes} episodes were asked for: expected 1 to {MISSIONS - skip}")
    first = FIRST_SEED[split] + skip
    return np.arange(first, first + n_episodes, dtype=np.int64)
