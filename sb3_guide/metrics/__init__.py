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
from sb3_guide.metrics.resampling import episode_sums, ratio_interval

__all__ = [
    "cic",
    "cic_as_published",
    "conditional",
    "episode_sums",
    "influence",
    "joint_counts",
    "message_entropy",
    "obedience",
    "positive_signalling",
    "ratio_interval",
    "symbol_information",
    "tempered",
    "uniform_cic",
]
