"""Levels whose demonstrations are pooled, such as GoToLocal+PickupLoc (paper section 4.3)."""

from collections.abc import Sequence

from sb3_guide.envs import level_of


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
