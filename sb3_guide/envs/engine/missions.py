"""Missions: clauses with descriptions of objects, the sets that they mean, and their words."""

from __future__ import annotations

import numpy as np

from sb3_guide.envs.engine.cells import AHEAD, COLOURS, DOOR, KEY, LOCKED, STRIDE, TYPE_BITS
from sb3_guide.envs.engine.compiled import compiled, compiled_for_python
from sb3_guide.envs.engine.rooms import distance, in_room, room_of
from sb3_guide.envs.engine.state import (
    AFTER,
    ANY,
    BEFORE,
    FRONT,
    LEFT,
    NOTHING,
    PUTNEXT,
    RIGHT,
    Rules,
    World,
)
from sb3_guide.envs.vocabulary import MISSION_LENGTH, encode

_ONE, _ZERO = np.uint64(1), np.uint64(0)


_LONGEST = 4  # words of a phrase


def _phrases(*texts: str) -> np.ndarray:
    """:return: (len(texts), 4) uint8, the tokens of each text, padded with 0"""
    return np.stack([encode(text)[:_LONGEST] for text in texts])


_VERBS = _phrases("go to", "pick up", "open", "put")  # in the order of the clauses' kinds
_PLACES = _phrases("on your left", "on your right", "in front of you", "behind you")  # in the order of the locations
_NEXT_TO, _AND, _THEN, _AFTER, _THE, _A = _phrases("next to", "and", ", then", "after you", "the", "a")
_COLOURS = _phrases(*COLOURS)
_TYPES = _phrases("door", "key", "ball", "box")  # from DOOR on


@compiled_for_python
def clear_mission(world: World) -> None:
    """Forget the mission before a new one is drawn."""
    world.clauses = 0
    world.connective = 0
    world.second_side = 0
    world.first_done = False
    world.targets[:] = 0
    world.described[:] = ANY


@compiled_for_python
def add_clause(world: World, kind: int, description: tuple[int, int, int]) -> None:
    """
    Append a clause.

    :param kind: GOTO, PICKUP, OPEN_DOOR or PUTNEXT
    :param description: type, colour or ANY, location or ANY of the object (of the one to move, for PUTNEXT)
    """
    clause = world.clauses
    world.kind[clause] = kind
    world.carried_before[clause] = NOTHING
    world.done[clause] = False
    world.clauses += 1
    describe(world, 0, description)


@compiled_for_python
def describe(world: World, which: int, description: tuple[int, int, int]) -> None:
    """Set a description of the newest clause: 0 the object, 1 the fixed object of PUTNEXT."""
    for field in range(3):
        world.described[world.clauses - 1, which, field] = description[field]


@compiled
def lies_towards(world: World, rules: Rules, position: int, location: int) -> bool:
    """:return: whether the position is in the agent's room and left of, right of, in front of or behind the agent"""
    if not in_room(rules, room_of(rules, world.agent), position):
        return False
    x, y = position % STRIDE - world.agent % STRIDE, position // STRIDE - world.agent // STRIDE
    ahead = AHEAD[world.direction]
    dx, dy = (ahead, 0) if abs(ahead) == 1 else (0, ahead // STRIDE)
    forward, rightward = x * dx + y * dy, y * dx - x * dy
    if location == LEFT:
        return rightward < 0
    if location == RIGHT:
        return rightward > 0
    return forward > 0 if location == FRONT else forward < 0


@compiled
def matching(world: World, rules: Rules, description: tuple[int, int, int]) -> np.uint64:
    """:return: the set of objects in the grid that match, as a mask"""
    kind, colour, location = description
    found = _ZERO
    for thing in range(world.objects):
        look = world.look[thing]
        if look & TYPE_BITS != kind or (colour != ANY and look >> 3 != colour):
            continue
        if location == ANY or lies_towards(world, rules, world.position[thing], location):
            found |= _ONE << np.uint64(thing)
    return found


@compiled
def contains(things: np.uint64, thing: int) -> bool:
    """:return: whether the set has the object"""
    return (things >> np.uint64(thing)) & _ONE != _ZERO


@compiled_for_python
def resolve_targets(world: World, rules: Rules) -> None:
    """Fix what the descriptions mean for the whole episode."""
    for clause in range(world.clauses):
        for which in range(2 if world.kind[clause] == PUTNEXT else 1):
            words = world.described[clause, which]
            world.targets[clause, which] = matching(world, rules, (words[0], words[1], words[2]))


@compiled
def any_adjacent(world: World, moved: np.uint64, fixed: np.uint64) -> bool:
    """:return: whether an object of the first set lies next to one of the second"""
    for a in range(world.objects):
        for b in range(world.objects):
            if contains(moved, a) and contains(fixed, b) and distance(world.position[a], world.position[b]) == 1:
                return True
    return False


@compiled
def opens_a_door(world: World, look: int) -> bool:
    """:return: whether a key of this look fits a locked door"""
    for thing in range(world.objects):
        if world.look[thing] >> 3 == look >> 3 and world.cells[world.position[thing]] >> 6 == LOCKED:
            return True
    return False


@compiled
def is_valid(world: World, rules: Rules) -> bool:
    """:return: whether the mission is not done at the start and, where Minigrid asks for it, leaves needed keys alone"""
    for clause in range(world.clauses):
        if world.kind[clause] == PUTNEXT:
            moved, fixed = world.targets[clause, 0], world.targets[clause, 1]
            if moved & fixed != _ZERO or any_adjacent(world, moved, fixed):
                return False
        for which in range(2):
            kind, colour = world.described[clause, which, 0], world.described[clause, which, 1]
            if rules.unblocking and kind == KEY and colour != ANY and opens_a_door(world, KEY | colour << 3):
                return False
    return True


@compiled
def say(world: World, length: int, phrase: np.ndarray) -> int:
    """Append a phrase to the mission. :return: the mission's new length"""
    for word in phrase:
        if word:
            world.mission[length] = word
            length += 1
    return length


@compiled
def say_description(world: World, length: int, clause: int, which: int) -> int:
    """Append a description, such as "a red ball on your left". :return: the mission's new length"""
    words = world.described[clause, which]
    kind, colour, location = words[0], words[1], words[2]
    things = world.targets[clause, which]
    length = say(world, length, _A if things & (things - _ONE) != _ZERO else _THE)  # "a" where two or more match
    if colour != ANY:
        length = say(world, length, _COLOURS[colour])
    length = say(world, length, _TYPES[kind - DOOR])
    return length if location == ANY else say(world, length, _PLACES[location])


@compiled
def say_clause(world: World, length: int, clause: int) -> int:
    """Append a clause, such as "go to the red ball". :return: the mission's new length"""
    length = say_description(world, say(world, length, _VERBS[world.kind[clause]]), clause, 0)
    if world.kind[clause] != PUTNEXT:
        return length
    return say_description(world, say(world, length, _NEXT_TO), clause, 1)


@compiled
def write_mission(world: World) -> None:
    """Put the whole mission into words."""
    length = 0
    for clause in range(world.clauses):
        if clause and clause != world.second_side:
            length = say(world, length, _AND)
        elif clause and world.connective == BEFORE:
            length = say(world, length, _THEN)
        elif clause and world.connective == AFTER:
            length = say(world, length, _AFTER)
        length = say_clause(world, length, clause)
    world.mission[length:MISSION_LENGTH] = 0


@compiled_for_python
def steps_allowed(world: World, rules: Rules) -> int:
    """:return: the step limit: every walk to an object may take as many steps as the rooms have cells"""
    walks = world.clauses
    for clause in range(world.clauses):
        walks += world.kind[clause] == PUTNEXT
    return walks * rules.room_size**2 * rules.rows * rules.columns
