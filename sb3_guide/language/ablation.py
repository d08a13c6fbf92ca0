"""What becomes of success when messages pass through an intervention on the way."""

from collections.abc import Mapping

import numpy as np

from sb3_guide.cloning.episodes import play
from sb3_guide.language.reading import Reading
from sb3_guide.policies import AgentPolicy
from sb3_guide.policies.interventions import Delayed, Intervention, Marginal, Shuffled, Silent, Swapped, Uniform


def ablations(reading: Reading) -> dict[str, Intervention]:
    """
    :param reading: of the agent, for how often it says what, on missions that it is not to be ablated on
    :return: the interventions by name, "spoken" first
    """
    frequency = np.bincount(reading.messages, minlength=reading.shape.count) / len(reading.messages)
    return {
        "spoken": Intervention(),
        "silent": Silent(),
        "uniform": Uniform(),
        "marginal": Marginal(tuple(frequency.tolist())),
        "shuffled": Shuffled(),
        "delayed": Delayed(),
        **{f"swapped {position}": Swapped(position) for position in range(reading.shape.length)},
    }


def ablate(
    policy: AgentPolicy, level: str, seeds: np.ndarray, interventions: Mapping[str, Intervention]
) -> dict[str, np.ndarray]:
    """
    :param policy: with a channel
    :param level: name or id of the level, or id of another environment
    :param seeds: (E,) of the missions, the same for each intervention
    :param interventions: by name
    :return: (E,) bool by name, whether each mission succeeded
    :raises ValueError: if the agent has no channel
    """
    found = {}
    for name, intervention in interventions.items():
        with policy.hearing(intervention):
            found[name] = play(policy, level, seeds).successes
    return found
