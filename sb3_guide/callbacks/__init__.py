"""Callbacks for SB3's algorithms; imitation's hooks take :class:`sb3_guide.cloning.Validation`."""

from sb3_guide.callbacks.checkpoint import TrainingCheckpoint, restore_training
from sb3_guide.callbacks.communication import CICCallback
from sb3_guide.callbacks.curriculum import Curriculum
from sb3_guide.callbacks.language import LanguageCallback
from sb3_guide.callbacks.success import StopTrainingOnSuccessRate, SuccessRateCallback

__all__ = [
    "CICCallback",
    "Curriculum",
    "LanguageCallback",
    "StopTrainingOnSuccessRate",
    "SuccessRateCallback",
    "TrainingCheckpoint",
    "restore_training",
]
