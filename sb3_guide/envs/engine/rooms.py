"""The grid of rooms: walls, doors, objects and the agent's start, in the order in which Minigrid's `RoomGrid` draws them."""

from __future__ import annotations

import numpy as np

from sb3_guide.envs.engine.cells import (
    AHEAD,
    CLOSED,
    COLOUR_DRAWS,
    DOOR,
    EMPTY,
    KEY,
    LOCKED,
    PADDING,
    STRIDE,
    TYPE_BITS,
    WALL,
)
from sb3_guide.envs.engine.compiled import compiled
from sb3_guide.envs.engine.state import NOTHING, Rules, World
from sb3_guide.envs.engine.stream import draw

_PLACE_TRIES = 1001  # Minigrid gives up a grid after so many draws of a position ...
_CONNECT_TRIES = 5001  # ... or of a door
_RANKS = np.argsort(COLOUR_DRAWS)  # where a colour stands in the draw


@compiled
def position_of(x: int, y: int) -> int:
    """:return: flat index of column x and row y of the level"""
    return (y + PADDING) * STRIDE + x


@compiled
def distance(a: int, b: int) -> int:
    """:return: Manhattan distance of two positions"""
    return abs(a % STRIDE - b % STRIDE) + abs(a // STRIDE - b // STRIDE)


@compiled
def room_of(rules: Rules, position: int) -> int:
    """:return: index of the room; a shared wall belongs to the room on its right or below"""
    x, y = position % STRIDE, position // STRIDE - PADDING
    return y // (rules.room_size - 1) * rules.columns + x // (rules.room_size - 1)


@compiled
def in_room(rules: Rules, room: int, position: int) -> bool:
    """:return: whether the position lies in the room, its walls included"""
    x = position % STRIDE - room % rules.columns * (rules.room_size - 1)
    y = position // STRIDE - PADDING - room // rules.columns * (rules.room_size - 1)
    return 0 <= x < rules.room_size and 0 <= y < rules.room_size


@compiled
def neighbour(rules: Rules, room: int, side: int) -> int:
    """:return: the room to the right, below, to the left or above, or NOTHING"""
    column, row = room % rules.columns, room // rules.columns
    if side == 0:
        return room + 1 if column + 1 < rules.columns else NOTHING
    if side == 1:
        return room + rules.columns if row + 1 < rules.rows else NOTHING
    if side == 2:
        return room - 1 if column > 0 else NOTHING
    return room - rules.columns if row > 0 else NOTHING


@compiled
def build_rooms(world: World, rules: Rules) -> None:
    """Draw the places of possible doors and put the agent into the middle, without objects."""
    inner = rules.room_size - 1
    world.cells[:] = WALL
    world.objects = 0
    world.doors[:] = NOTHING
    world.door_position[:] = NOTHING
    world.room_locked[:] = False
    world.locked_room = NOTHING
    for room in range(rules.rows * rules.columns):
        left, top = room % rules.columns * inner, room // rules.columns * inner
        for y in range(top + 1, top + inner):
            start = position_of(left + 1, y)
            world.cells[start : start + inner - 1] = EMPTY
        beside, below = neighbour(rules, room, 0), neighbour(rules, room, 1)
        if beside != NOTHING:
            position = position_of(left + inner, draw(world, top + 1, top + inner))
            world.door_position[room, 0] = world.door_position[beside, 2] = position
        if below != NOTHING:
            position = position_of(draw(world, left + 1, left + inner), top + inner)
            world.door_position[room, 1] = world.door_position[below, 3] = position
    half = rules.room_size // 2
    world.agent = position_of(rules.columns // 2 * inner + half, rules.rows // 2 * inner + half)
    world.direction = 0


@compiled
def add_thing(world: World, look: int, position: int) -> int:
    """:return: index of the new object or door"""
    thing = world.objects
    world.look[thing] = look
    world.position[thing] = position
    world.objects += 1
    return thing


@compiled
def draw_colour(world: World, without: int) -> int:
    """:return: one of the six colours, or of five if one is left out"""
    if without == NOTHING:
        return COLOUR_DRAWS[draw(world, 0, len(COLOUR_DRAWS))]
    rank = draw(world, 0, len(COLOUR_DRAWS) - 1)
    return COLOUR_DRAWS[rank + (rank >= _RANKS[without])]


@compiled
def draw_room(world: World, rules: Rules) -> int:
    """:return: a room, its column drawn before its row"""
    column = draw(world, 0, rules.columns)
    return draw(world, 0, rules.rows) * rules.columns + column


@compiled
def corner_of(rules: Rules, room: int) -> int:
    """:return: position of the room's top left corner"""
    inner = rules.room_size - 1
    return position_of(room % rules.columns * inner, room // rules.columns * inner)


@compiled
def draw_position(world: World, rules: Rules, corner: int) -> int:
    """:return: a position in the room with this corner, its walls included"""
    x = draw(world, 0, rules.room_size)
    return corner + x + draw(world, 0, rules.room_size) * STRIDE


@compiled
def add_object(world: World, rules: Rules, room: int, look: int) -> bool:
    """:return: whether a free cell, not next to the agent, was found for the new object"""
    corner = corner_of(rules, room)
    for _ in range(_PLACE_TRIES):
        position = draw_position(world, rules, corner)
        if world.cells[position] == EMPTY and distance(position, world.agent) >= 2:
            world.cells[position] = look
            add_thing(world, look, position)
            return True
    return False


@compiled
def has_look(world: World, look: int) -> bool:
    """:return: whether an object looks like that"""
    for thing in range(world.objects):  # noqa: SIM110  numba has no any() of a generator
        if world.look[thing] == look:
            return True
    return False


@compiled
def add_distractors(world: World, rules: Rules, room: int, count: int, unique: bool) -> bool:
    """
    Add random keys, balls and boxes.

    :param room: where, or NOTHING for a room drawn for each
    :param count: how many
    :param unique: whether no two objects of the world may look alike
    :return: whether there was space for all
    """
    added = 0
    while added < count:
        colour = draw_colour(world, NOTHING)
        look = KEY + draw(world, 0, 3) | colour << 3
        if unique and has_look(world, look):
            continue
        place = draw_room(world, rules) if room == NOTHING else room
        if not add_object(world, rules, place, look):
            return False
        added += 1
    return True


@compiled
def add_door(world: World, rules: Rules, room: int, side: int, colour: int, state: int) -> None:
    """Put a door between the room and its neighbour."""
    look = DOOR | colour << 3
    position = world.door_position[room, side]
    world.cells[position] = look | state << 6
    door = add_thing(world, look, position)
    world.doors[room, side] = world.doors[neighbour(rules, room, side), (side + 2) % 4] = door
    world.room_locked[room] = state == LOCKED


@compiled
def connected(world: World, rules: Rules) -> bool:
    """:return: whether doors lead from any room to all others"""
    rooms = rules.rows * rules.columns
    reached, before = 1, 0
    while reached != before:
        before = reached
        for room in range(rooms):
            if reached >> room & 1:
                for side in range(4):
                    if world.doors[room, side] != NOTHING:
                        reached |= 1 << neighbour(rules, room, side)
    return reached == (1 << rooms) - 1


@compiled
def connect_all(world: World, rules: Rules, without: int) -> bool:
    """
    Add doors until every room can be reached. A locked room keeps its one door.

    :param without: a colour that no door gets, or NOTHING
    :return: False if that is impossible
    """
    for _ in range(_CONNECT_TRIES):
        if connected(world, rules):
            return True
        room = draw_room(world, rules)
        side = draw(world, 0, 4)
        if world.door_position[room, side] == NOTHING or world.doors[room, side] != NOTHING:
            continue
        if world.room_locked[room] or world.room_locked[neighbour(rules, room, side)]:
            continue
        add_door(world, rules, room, side, draw_colour(world, without), CLOSED)
    return False


@compiled
def place_agent(world: World, rules: Rules) -> bool:
    """:return: whether the agent found a free cell in a drawn room, facing another free cell or a wall"""
    corner = corner_of(rules, draw_room(world, rules))
    while True:
        tries = 0
        position = draw_position(world, rules, corner)
        while world.cells[position] != EMPTY:
            tries += 1
            if tries == _PLACE_TRIES:
                return False
            position = draw_position(world, rules, corner)
        world.agent = position
        world.direction = draw(world, 0, 4)
        front = world.cells[position + AHEAD[world.direction]]
        if front in (EMPTY, WALL):
            return True


@compiled
def around(rows: np.ndarray, row: int) -> int:
    """:return: bits of the columns in this row that are set or next to one that is set, in rows of bits"""
    return rows[row] | rows[row] << 1 | rows[row] >> 1 | rows[row - 1] | rows[row + 1]


@compiled
def all_reachable(world: World, rules: Rules) -> bool:
    """:return: whether the agent can come next to every object and door without moving an object; locks do not count"""
    inner = rules.room_size - 1
    top, bottom, width = PADDING, PADDING + rules.rows * inner, rules.columns * inner
    for row in range(top, bottom + 1):
        world.reached[row] = world.clear[row] = 0
        for column in range(width):
            cell = world.cells[row * STRIDE + column]
            world.clear[row] |= (cell == EMPTY or cell & TYPE_BITS == DOOR) << column
    world.reached[world.agent // STRIDE] = 1 << world.agent % STRIDE
    growing = True
    while growing:
        growing = False
        for row in range(top + 1, bottom):
            reached = around(world.reached, row) & world.clear[row]
            growing |= reached != world.reached[row]
            world.reached[row] = reached
    for thing in range(world.objects):
        row, column = world.position[thing] // STRIDE, world.position[thing] % STRIDE
        if not around(world.reached, row) >> column & 1:
            return False
    return True
