"""Callbacks for SB3's algorithms and for imitation's hooks."""

from sb3_guide.callbacks.checkpoint import TrainingCheckpoint, restore_training
from sb3_guide.callbacks.cloning import EpochMetrics
from sb3_guide.callbacks.communication import CICCallback, measure_communication
from sb3_guide.callbacks.success import StopTrainingOnSuccessRate, SuccessRateCallback

__all__ = [
    "CICCallback",
    "EpochMetrics",
    "StopTrainingOnSuccessRate",
    "SuccessRateCallback",
    "TrainingCheckpoint",
    "measure_communication",
    "restore_training",
]
