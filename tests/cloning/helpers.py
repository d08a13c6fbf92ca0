"""Episodes that nobody played."""

import numpy as np

from sb3_guide.cloning import Demonstrations, Episodes


def make_episodes(lengths: list[int], seed: int = 0, returns: float = 0.5) -> Episodes:
    """Episodes of these lengths with random images, actions and missions of five words."""
    rng = np.random.default_rng(seed)
    frames, episodes = sum(lengths), len(lengths)
    missions = np.zeros((episodes, 72), dtype=np.uint8)
    missions[:, :5] = rng.integers(1, 26, (episodes, 5))
    return Episodes(
        images=rng.integers(1, 3, (frames, 7, 7, 3), dtype=np.uint8),
        actions=rng.integers(0, 7, frames, dtype=np.uint8),
        missions=missions,
        offsets=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        returns=np.full(episodes, returns),
        seeds=np.arange(episodes, dtype=np.int64),
    )


def make_demonstrations(lengths: list[int], seed: int = 0) -> Demonstrations:
    """Demonstrations of these lengths."""
    return Demonstrations(make_episodes(lengths, seed), "GoToObj", {"expert": "none"})
