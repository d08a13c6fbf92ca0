"""Reading and speaking the language of agents with a channel (paper section 5)."""

from sb3_guide.language.ablation import ablate, ablations
from sb3_guide.language.dictionary import Dictionary, learn
from sb3_guide.language.reading import Reading, memory_of, read
from sb3_guide.language.situations import SITUATIONS, situations, targets
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
    "memory_of",
    "obey",
    "perform",
    "read",
    "situations",
    "speak",
    "steps_of",
    "targets",
]
