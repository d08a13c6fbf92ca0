"""Reading and speaking the language of agents with a channel (paper section 5)."""

from sb3_guide.language.ablation import ablate, ablations
from sb3_guide.language.dictionary import Dictionary, learn, overhear, read_dictionary, save_dictionary
from sb3_guide.language.reading import Reading, read, read_along
from sb3_guide.language.situations import SITUATIONS, meanings, situations, targets
from sb3_guide.language.speaking import CHOREOGRAPHIES, Performance, danced, obey, perform, speak, steps_of

__all__ = [
    "CHOREOGRAPHIES",
    "SITUATIONS",
    "Dictionary",
    "Performance",
    "Reading",
    "ablate",
    "ablations",
    "danced",
    "learn",
    "meanings",
    "obey",
    "overhear",
    "perform",
    "read",
    "read_along",
    "read_dictionary",
    "save_dictionary",
    "situations",
    "speak",
    "steps_of",
    "targets",
]
