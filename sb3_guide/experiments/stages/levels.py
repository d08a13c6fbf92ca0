"""Where agents live: one environment, or several whose demonstrations are pooled (paper section 4.3)."""

from collections.abc import Sequence
from importlib import import_module

from sb3_guide.envs import name_of


def environment(text: str) -> str:
    """
    :param text: name or id of a level, or id of another environment; PACKAGE:ID imports the package first, which registers it
    :return: name of the level, or that id
    :raises ValueError: if there is no such package or environment
    """
    package, _, env_id = text.rpartition(":")
    if package:
        try:
            import_module(package)
        except ImportError as error:
            raise ValueError(f"{text}: the package {package!r} can't be imported ({error})") from error
    return name_of(env_id)


def split_levels(text: str) -> list[str]:
    """
    :param text: levels as :func:`environment` takes them, joined by "+", such as GoToLocal+PickupLoc
    :return: their names, each once, in this order
    :raises ValueError: if one is unknown
    """
    return list(dict.fromkeys(environment(part) for part in text.split("+")))


def join_levels(levels: Sequence[str]) -> str:
    """
    :param levels: names
    :return: the same as one text
    """
    return "+".join(levels)
