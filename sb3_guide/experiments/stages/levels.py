"""Which level: several whose demonstrations are pooled, such as GoToLocal+PickupLoc (paper section 4.3), or an agent's own."""

from collections.abc import Sequence
from pathlib import Path

from sb3_guide.envs import level_of
from sb3_guide.policies.folder import read_agent


def split_levels(text: str) -> list[str]:
    """
    :param text: names or ids of levels, joined by "+"
    :return: their names, each once, in this order
    :raises ValueError: if a level is unknown
    """
    return list(dict.fromkeys(level_of(part).name for part in text.split("+")))


def join_levels(levels: Sequence[str]) -> str:
    """
    :param levels: names
    :return: the same as one text
    """
    return "+".join(levels)


def level_of_agent(agent: Path, level: str | None) -> str:
    """
    :param agent: folder of an agent
    :param level: name or id of the level on which it is to be read or spoken to; None takes the one that it was trained on
    :return: name of the level
    :raises ValueError: if the agent was not trained on it, or on several and it is not said which
    """
    trained = (read_agent(agent)[0].level or "").split("+")
    if level is None and len(trained) == 1 and trained[0]:
        return level_of(trained[0]).name
    expected = " or ".join(f"--level {name}" for name in trained if name)
    if level is None:
        raise ValueError(f"which level shall the agent in {agent} play? expected {expected or '--level NAME'}")
    name = level_of(level).name
    if expected and name not in trained:
        raise ValueError(f"the agent in {agent} was not trained on {name}: expected {expected}")
    return name
