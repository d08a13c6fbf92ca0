"""Where agents live: one environment, or several whose demonstrations are pooled (paper section 4.3)."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from sb3_guide.envs import is_level, level_of, name_of
from sb3_guide.policies.folder import read_agent


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


def level_of_agent(agent: Path, level: str | None) -> str:
    """
    :param agent: folder of an agent
    :param level: where it is to be read or spoken to, see :func:`environment`; None takes where it was trained
    :return: name of the level, or id of another environment
    :raises ValueError: if the agent was not trained on it, or on several and it is not said which
    """
    parts = (read_agent(agent)[0].level or "").split("+")
    trained = [level_of(part).name if is_level(part) else part for part in parts]
    if level is None and len(trained) == 1 and trained[0]:
        return name_of(trained[0])
    expected = " or ".join(f"--level {name}" for name in trained if name)
    if level is None:
        raise ValueError(f"which level shall the agent in {agent} play? expected {expected or '--level NAME'}")
    name = environment(level)
    if expected and name not in trained:
        raise ValueError(f"the agent in {agent} was not trained on {name}: expected {expected}")
    return name
