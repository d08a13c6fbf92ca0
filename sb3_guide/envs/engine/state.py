"""What a world is: one record, the same for all levels."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from sb3_guide.envs.engine.cells import AREA, STRIDE
from sb3_guide.envs.vocabulary import MISSION_LENGTH

MAX_OBJECTS = 64  # doors included; a set of objects is a mask of 64 bits
MAX_ROOMS = 9
MAX_CLAUSES = 4

CARRIED, GONE = -1, -2  # positions of objects that are not in the grid
NOTHING = -1  # no object, no door, no room

GOTO, PICKUP, OPEN_DOOR, PUTNEXT = 0, 1, 2, 3  # kinds of clauses
ALONE, BEFORE, AFTER = 0, 1, 2  # how the two sides of a mission are connected
ANY = -1  # a description without colour or without location
LEFT, RIGHT, FRONT, BEHIND = 0, 1, 2, 3  # locations, in Minigrid's order

World: TypeAlias = Any  # one record of WORLD, which numba hands over by reference
Rules: TypeAlias = Any  # one record of RULES

WORLD = np.dtype(
    [
        ("stream", np.uint64, (4,)),  # PCG64: high and low word of the state, high and low word of the increment
        ("has_uint32", np.uint32),  # whether a half word waits for the next draw
        ("uinteger", np.uint32),  # that half word
        ("steps", np.int32),
        ("max_steps", np.int32),  # 0 before the first episode
        ("agent", np.int16),  # position
        ("direction", np.int8),  # right, down, left, up
        ("carrying", np.int8),  # object or NOTHING
        ("objects", np.int8),  # how many there are, in order of their creation
        ("look", np.int8, (MAX_OBJECTS,)),  # type and colour
        ("position", np.int16, (MAX_OBJECTS,)),
        ("tracked", np.int16, (MAX_OBJECTS,)),  # the positions that the verifier believes in, renewed by every drop
        ("clauses", np.int8),
        ("kind", np.int8, (MAX_CLAUSES,)),
        ("described", np.int8, (MAX_CLAUSES, 2, 3)),  # type, colour or ANY, location or ANY of both descriptions
        ("targets", np.uint64, (MAX_CLAUSES, 2)),  # sets of objects that the descriptions mean
        ("carried_before", np.int8, (MAX_CLAUSES,)),  # what the agent carried when the clause was last verified
        ("done", np.uint8, (MAX_CLAUSES,)),  # numba knows no arrays of bool inside a record
        ("second_side", np.int8),  # first clause of the second side
        ("connective", np.int8),
        ("first_done", np.bool_),  # whether the side that comes first in time is done
        ("mission", np.uint8, (MISSION_LENGTH,)),
        ("doors", np.int8, (MAX_ROOMS, 4)),  # object or NOTHING, to the right, down, left, up
        ("door_position", np.int16, (MAX_ROOMS, 4)),  # or NOTHING where the grid ends
        ("room_locked", np.uint8, (MAX_ROOMS,)),
        ("locked_room", np.int8),  # or NOTHING
        ("cells", np.uint8, (AREA,)),
        # The generator's notes: for every row of cells a bit for every column, whether the agent could stand there, and come.
        ("clear", np.int32, (AREA // STRIDE,)),
        ("reached", np.int32, (AREA // STRIDE,)),
    ],
    align=True,
)

ROOMS, LOCKED_ROOM, LANGUAGE = 0, 1, 2  # recipes of generation
ANYWHERE, REACHABLE, BLOCKED = 0, 1, 2  # what must hold for the objects before the mission is drawn

# What the generator needs to know about a level; `Level` explains the fields.
RULES = np.dtype(
    [
        *[(name, np.int64) for name in ("recipe", "columns", "rows", "room_size", "distractors", "target", "access")],
        *[(name, np.int64) for name in ("actions", "sentences")],
        *[(name, np.bool_) for name in ("unique", "red_ball", "grey", "locations", "unblocking", "implicit_unlock")],
        ("locked_room_probability", np.float64),
    ],
    align=True,
)
