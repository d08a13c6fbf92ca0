"""Callbacks for SB3's algorithms; imitation's hooks take LanguagePictures and :class:`sb3_guide.cloning.Validation`."""

from sb3_guide.callbacks.checkpoint import TrainingCheckpoint, restore_training
from sb3_guide.callbacks.communication import CICCallback
from sb3_guide.callbacks.curriculum import Curriculum
from sb3_guide.callbacks.language import LanguageCallback, LanguagePictures
from sb3_guide.callbacks.success import EpisodeSuccesses, StopTrainingOnSuccessRate, SuccessRateCallback

__all__ = [
    "CICCallback",
    "Curriculum",
    "EpisodeSuccesses",
    "LanguageCallback",
    "LanguagePictures",
    "StopTrainingOnSuccessRate",
    "SuccessRateCallback",
    "TrainingCheckpoint",
    "restore_training",
]
