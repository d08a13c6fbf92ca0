"""Pure functions that measure emergent communication."""

from sb3_guide.metrics.communication import (
    cic,
    cic_as_published,
    influence,
    message_entropy,
    positive_signalling,
    tempered,
    uniform_cic,
)
from sb3_guide.metrics.language import conditional, joint_counts, obedience, symbol_information
from sb3_guide.metrics.lexicon import (
    agreement,
    differences,
    edit_distances,
    positional_disentanglement,
    topographic_similarity,
)
from sb3_guide.metrics.resampling import by_chance, episode_sums, interval, p_value, ratio_interval

__all__ = [
    "agreement",
    "by_chance",
    "cic",
    "cic_as_published",
    "conditional",
    "differences",
    "edit_distances",
    "episode_sums",
    "influence",
    "interval",
    "joint_counts",
    "message_entropy",
    "obedience",
    "p_value",
    "positional_disentanglement",
    "positive_signalling",
    "ratio_interval",
    "symbol_information",
    "tempered",
    "topographic_similarity",
    "uniform_cic",
]
