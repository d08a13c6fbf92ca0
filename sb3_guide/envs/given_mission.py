"""A mission that a person puts in the place of a world's own, and that the engine verifies like one."""

from __future__ import annotations

import re

import numpy as np

from sb3_guide.envs.engine.cells import COLOURS, DOOR
from sb3_guide.envs.engine.missions import add_clause, clear_mission, describe, resolve_targets, steps_allowed
from sb3_guide.envs.engine.state import AFTER, ALONE, ANY, BEFORE, MAX_CLAUSES, PUTNEXT, WORLD
from sb3_guide.envs.levels import Level
from sb3_guide.envs.vocabulary import encode

_VERBS = ("go to", "pick up", "open", "put")  # in the order of the clauses' kinds
_TYPES = ("door", "key", "ball", "box")  # from DOOR on
_PLACES = ("on your left", "on your right", "in front of you", "behind you")  # in the order of the locations
_DESCRIPTION = rf"(?:a|the)(?: ({'|'.join(COLOURS)}))? ({'|'.join(_TYPES)})(?: ({'|'.join(_PLACES)}))?"
_CLAUSE = re.compile(rf"({'|'.join(_VERBS)}) {_DESCRIPTION}(?: next to {_DESCRIPTION})?")
_EXAMPLES = "'go to the red ball', 'pick up a key on your left', 'put the blue box next to the grey ball'"

Description = tuple[int, int, int]  # type, colour or ANY, location or ANY


def with_mission(state: dict[str, np.ndarray], level: Level, mission: str) -> dict[str, np.ndarray]:
    """
    Put another mission in the place of a world's own. Places such as "on your left" hold from where the agent stands.

    :param state: of one world, as of `GuideGridEnv.get_state`, where an episode has begun
    :param level: of the world
    :param mission: text as Minigrid writes it, such as "go to the red ball"
    :return: the same world with that mission and as many steps for it as the level would allow
    :raises ValueError: if the text is no mission
    """
    first, connective, second = _sides(mission)
    worlds, rules = np.zeros(1, dtype=WORLD), level.rules()
    for name, values in state.items():
        if name in (WORLD.names or ()):
            worlds[name] = values
    world = worlds[0]
    clear_mission(world)
    world["connective"], world["second_side"] = connective, len(first)
    for kind, *descriptions in _clauses([*first, *second], mission):
        add_clause(world, kind, descriptions[0])
        if kind == PUTNEXT:
            describe(world, 1, descriptions[1])
    resolve_targets(world, rules[0])
    world["mission"] = encode(mission)
    world["max_steps"] = steps_allowed(world, rules[0])
    return {**state, **{name: worlds[name].copy() for name in WORLD.names or ()}}


def has_targets(state: dict[str, np.ndarray]) -> bool:
    """:return: whether each thing that the mission of one world speaks of is there"""
    clauses = int(state["clauses"][0])
    needed = np.stack([np.ones(clauses, dtype=bool), state["kind"][0, :clauses] == PUTNEXT], axis=1)
    return bool((state["targets"][0, :clauses] != 0)[needed].all())


def _sides(mission: str) -> tuple[list[str], int, list[str]]:
    """:return: texts of the clauses of the first side, how the sides are connected, those of the second side"""
    for word, connective in ((", then ", BEFORE), (" after you ", AFTER)):
        first, found, second = mission.partition(word)
        if found:
            return first.split(" and "), connective, second.split(" and ")
    return mission.split(" and "), ALONE, []


def _clauses(texts: list[str], mission: str) -> list[tuple[int, Description, Description]]:
    """
    :param texts: of the clauses
    :param mission: that they are of
    :return: kind and both descriptions of each, the second one without meaning where there is none
    :raises ValueError: if one is no clause, or there are too many
    """
    found = []
    for text in texts:
        match = _CLAUSE.fullmatch(text)
        if match is None or (match[1] == "put") != (match[6] is not None):
            raise ValueError(f"{text!r} is no mission: expected one such as {_EXAMPLES}, or several with 'and' or ', then'")
        found.append((_VERBS.index(match[1]), _described(*match.groups()[1:4]), _described(*match.groups()[4:])))
    if len(found) > MAX_CLAUSES:
        raise ValueError(f"the mission has {len(found)} parts, expected at most {MAX_CLAUSES}: {mission!r}")
    return found


def _described(colour: str | None, kind: str | None, place: str | None) -> Description:
    return (
        _TYPES.index(kind) + DOOR if kind else ANY,
        COLOURS.index(colour) if colour else ANY,
        _PLACES.index(place) if place else ANY,
    )
