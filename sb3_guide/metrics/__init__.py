"""Pure functions that measure emergent communication."""

from sb3_guide.metrics.communication import cic, message_entropy, positive_signalling, uniform_cic
from sb3_guide.metrics.language import conditional, message_action_counts

__all__ = ["cic", "conditional", "message_action_counts", "message_entropy", "positive_signalling", "uniform_cic"]
