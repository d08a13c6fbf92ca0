"""Demonstrations and behavioural cloning; :mod:`sb3_guide.cloning.bc` alone needs imitation."""

from sb3_guide.cloning.demonstrations import Demonstrations, load_demonstrations, save_demonstrations
from sb3_guide.cloning.episodes import Episodes, play
from sb3_guide.cloning.splits import mission_seeds
from sb3_guide.cloning.validation import Validation, measure_communication

__all__ = [
    "Demonstrations",
    "Episodes",
    "Validation",
    "load_demonstrations",
    "measure_communication",
    "mission_seeds",
    "play",
    "save_demonstrations",
]
