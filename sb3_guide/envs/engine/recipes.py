"""How the levels draw their worlds and missions: three recipes with Minigrid's order of draws."""

from __future__ import annotations

import numpy as np

from sb3_guide.envs.engine.cells import BALL, BOX, COLOUR_DRAWS, DOOR, GREY, KEY, LOCKED, RED, TYPE_BITS
from sb3_guide.envs.engine.compiled import compiled
from sb3_guide.envs.engine.dynamics import track
from sb3_guide.envs.engine.missions import (
    add_clause,
    clear_mission,
    contains,
    describe,
    is_valid,
    matching,
    resolve_targets,
    steps_allowed,
    write_mission,
)
from sb3_guide.envs.engine.rooms import (
    add_distractors,
    add_door,
    add_object,
    all_reachable,
    build_rooms,
    connect_all,
    draw_colour,
    draw_room,
    in_room,
    neighbour,
    place_agent,
    room_of,
)
from sb3_guide.envs.engine.state import (
    AFTER,
    ALONE,
    ANY,
    ANYWHERE,
    BEFORE,
    GOTO,
    LOCKED_ROOM,
    NOTHING,
    OPEN_DOOR,
    PUTNEXT,
    REACHABLE,
    ROOMS,
    Rules,
    World,
)
from sb3_guide.envs.engine.stream import draw, draw_bool, draw_unit

_DESCRIBE_TRIES = 101  # Minigrid gives up a grid after so many draws of a description
_TYPES = BOX - DOOR + 1
_EMPTY_SET = np.uint64(0)


@compiled
def appearance(world: World, thing: int) -> tuple[int, int, int]:
    """:return: the description of an object by its type and colour"""
    return world.look[thing] & TYPE_BITS, world.look[thing] >> 3, ANY


@compiled
def turn_grey(world: World, first: int) -> None:
    """Take the colour from the objects from the first one on."""
    for thing in range(first, world.objects):
        world.look[thing] = (world.look[thing] & TYPE_BITS) | GREY << 3
        world.cells[world.position[thing]] = world.look[thing]


@compiled
def draw_listed_door(world: World, rules: Rules, doors: int) -> int:
    """:return: a door, drawn as Minigrid does: rooms column by column, so every door is listed by both its rooms"""
    left = draw(world, 0, 2 * doors)
    found = NOTHING
    for column in range(rules.columns):
        for row in range(rules.rows):
            for door in world.doors[row * rules.columns + column]:
                if door != NOTHING:
                    found = door if left == 0 else found
                    left -= 1
    return found


@compiled
def draw_target(world: World, rules: Rules, first: int) -> None:
    """
    Draw the mission of a plain level.

    :param first: the first distractor's index; before it are the doors
    """
    if rules.red_ball:
        add_clause(world, GOTO, (BALL, RED, ANY))
        return
    if rules.target == OPEN_DOOR:
        add_clause(world, OPEN_DOOR, appearance(world, draw_listed_door(world, rules, first)))
        return
    chosen = draw(world, 0, rules.distractors)
    add_clause(world, rules.target, appearance(world, first + chosen))
    if rules.target == PUTNEXT:
        other = draw(world, 0, rules.distractors - 1)  # from the list without the chosen one
        describe(world, 1, appearance(world, first + other + (other >= chosen)))


@compiled
def make_rooms(world: World, rules: Rules) -> bool:
    """Recipe of the levels with one plain clause. :return: False if Minigrid would reject the grid"""
    if not (place_agent(world, rules) and connect_all(world, rules, NOTHING)):
        return False
    if rules.red_ball and not add_object(world, rules, 0, BALL | RED << 3):
        return False
    first = world.objects
    if not add_distractors(world, rules, NOTHING, rules.distractors, rules.unique):
        return False
    if rules.grey:
        turn_grey(world, first)
    if rules.access != ANYWHERE and all_reachable(world, rules) != (rules.access == REACHABLE):
        return False
    draw_target(world, rules, first)
    return True


@compiled
def lock(world: World, rules: Rules, room: int, side: int) -> int:
    """Put a locked door into a wall of the room. :return: its colour"""
    colour = draw_colour(world, NOTHING)
    add_door(world, rules, room, side, colour, LOCKED)
    world.locked_room = room
    return colour


@compiled
def place_agent_outside(world: World, rules: Rules) -> bool:
    """:return: whether the agent found a place, which is not in the locked room"""
    while place_agent(world, rules):
        if room_of(rules, world.agent) != world.locked_room:
            return True
    return False


@compiled
def make_locked_room(world: World, rules: Rules) -> bool:
    """
    Recipe of Unlock and GoToImpUnlock. Minigrid compares rooms by `is` on numpy integers here, which never holds:
    the key and distractors may lie in the locked room, and then the mission cannot be solved.

    :return: False if Minigrid would reject the grid
    """
    room = draw_room(world, rules)
    side = draw(world, 0, 4)
    while neighbour(rules, room, side) == NOTHING:
        side = draw(world, 0, 4)
    colour = lock(world, rules, room, side)
    if not add_object(world, rules, draw_room(world, rules), KEY | colour << 3):
        return False
    without = colour if rules.target == OPEN_DOOR and draw_bool(world) else NOTHING
    if not connect_all(world, rules, without):
        return False
    for column in range(rules.columns):
        for row in range(rules.rows):
            if not add_distractors(world, rules, row * rules.columns + column, rules.distractors, False):
                return False
    if not (place_agent_outside(world, rules) and all_reachable(world, rules)):
        return False
    if rules.target == OPEN_DOOR:
        add_clause(world, OPEN_DOOR, (DOOR, colour, ANY))
        return True
    if not add_distractors(world, rules, room, 1, False):
        return False
    add_clause(world, GOTO, appearance(world, world.objects - 1))
    return True


@compiled
def add_locked_room(world: World, rules: Rules) -> bool:
    """Lock a room and put the key into another one. :return: whether there was space for the key"""
    room = draw_room(world, rules)
    side = draw(world, 0, 4)
    while neighbour(rules, room, side) == NOTHING:
        room = draw_room(world, rules)
        side = draw(world, 0, 4)
    colour = lock(world, rules, room, side)
    key_room = draw_room(world, rules)
    while key_room == room:
        key_room = draw_room(world, rules)
    return add_object(world, rules, key_room, KEY | colour << 3)


@compiled
def only_behind_lock(world: World, rules: Rules, things: np.uint64) -> bool:
    """:return: whether all objects of the set are in the locked room"""
    if world.locked_room == NOTHING:
        return False
    for thing in range(world.objects):
        if contains(things, thing) and not in_room(rules, world.locked_room, world.position[thing]):
            return False
    return True


@compiled
def draw_description(world: World, rules: Rules, types: int, lowest: int) -> tuple[int, int, int]:
    """
    Draw a description that matches something.

    :param types: how many types there are to draw from
    :param lowest: the last of them; the draws run from BOX down to it
    :return: type, colour, location; the type is 0 if nothing was found
    """
    for _ in range(_DESCRIBE_TRIES):
        colour = draw(world, 0, len(COLOUR_DRAWS) + 1)
        kind = lowest + types - 1 - draw(world, 0, types)
        location = draw(world, 0, 4) if rules.locations and draw_bool(world) else ANY
        description = (kind, COLOUR_DRAWS[colour - 1] if colour else ANY, location)
        things = matching(world, rules, description)
        if things != _EMPTY_SET and (rules.implicit_unlock or not only_behind_lock(world, rules, things)):
            return description
    return 0, ANY, ANY


@compiled
def draw_clause(world: World, rules: Rules) -> bool:
    """:return: whether a clause was found"""
    action = rules.target + draw(world, 0, rules.actions)
    if action == GOTO:
        description = draw_description(world, rules, _TYPES, DOOR)
    elif action == OPEN_DOOR:
        description = draw_description(world, rules, 1, DOOR)
    else:
        description = draw_description(world, rules, _TYPES - 1, KEY)
    if description[0] == 0:
        return False
    add_clause(world, action, description)
    if action != PUTNEXT:
        return True
    fixed = draw_description(world, rules, _TYPES, DOOR)
    describe(world, 1, fixed)
    return fixed[0] != 0


@compiled
def draw_side(world: World, rules: Rules, clauses: int) -> bool:
    """:return: whether all clauses of this side were found"""
    for _ in range(clauses):  # noqa: SIM110  numba has no all() of a generator
        if not draw_clause(world, rules):
            return False
    return True


@compiled
def draw_sentence(world: World, rules: Rules) -> bool:
    """Draw a clause, two joined by "and", or two such sides in order. :return: whether that was found"""
    sentence = draw(world, 0, rules.sentences)
    if sentence < 2:
        return draw_side(world, rules, sentence + 1)
    if not draw_side(world, rules, 1 + draw(world, 0, 2)):
        return False
    world.second_side = world.clauses
    if not draw_side(world, rules, 1 + draw(world, 0, 2)):
        return False
    world.connective = BEFORE if draw(world, 0, 2) == 0 else AFTER
    return True


@compiled
def make_language(world: World, rules: Rules) -> bool:
    """Recipe of the levels that speak all of BabyAI's language. :return: False if Minigrid would reject the grid"""
    if draw_unit(world) < rules.locked_room_probability and not add_locked_room(world, rules):
        return False
    if not connect_all(world, rules, NOTHING):
        return False
    if not add_distractors(world, rules, NOTHING, rules.distractors, False):
        return False
    if not place_agent_outside(world, rules):
        return False
    if rules.access == REACHABLE and not all_reachable(world, rules):
        return False
    return draw_sentence(world, rules)


@compiled
def make(world: World, rules: Rules) -> bool:
    """Draw one grid and mission. :return: False if Minigrid would reject them"""
    build_rooms(world, rules)
    clear_mission(world)
    if rules.recipe == ROOMS:
        made = make_rooms(world, rules)
    elif rules.recipe == LOCKED_ROOM:
        made = make_locked_room(world, rules)
    else:
        made = make_language(world, rules)
    if not made:
        return False
    resolve_targets(world, rules)
    return is_valid(world, rules)


@compiled
def start_episode(world: World, rules: Rules) -> None:
    """Draw grids until Minigrid would accept one, and begin the episode."""
    while not make(world, rules):
        pass
    if world.connective == ALONE:
        world.second_side = world.clauses
    track(world)
    world.carrying = NOTHING
    world.steps = 0
    world.max_steps = steps_allowed(world, rules)
    write_mission(world)
