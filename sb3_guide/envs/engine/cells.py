"""
Cells of the grid, packed into a byte: type | colour << 3 | state << 6, with Minigrid's numbers.

A wall carries a state too, which makes "opaque" one comparison: code >= OPAQUE. Positions are flat indices into a grid
that is wider and higher than any level, so that no view ever leaves it.
"""

from __future__ import annotations

import numpy as np

EMPTY, DOOR, KEY, BALL, BOX = 1, 4, 5, 6, 7  # 0 is what the agent does not see
OPEN, CLOSED, LOCKED = 0, 1, 2
WALL = 2 | 5 << 3 | 1 << 6
OPAQUE = 1 << 6
TYPE_BITS, LOOK_BITS = 0b111, 0b111111  # a look is type and colour: what a door keeps when it opens

COLOURS = ("red", "green", "blue", "purple", "yellow", "grey")
COLOUR_DRAWS = np.array([COLOURS.index(name) for name in sorted(COLOURS)])  # Minigrid draws from the sorted names
RED, GREY = 0, 5

VIEW = 7
STRIDE = 32  # 22 columns of the largest level, and 10 of padding that serve both sides
PADDING = VIEW - 1
AREA = (22 + 2 * PADDING) * STRIDE
AHEAD = np.array([1, STRIDE, -1, -STRIDE])  # offset of the next cell to the right, down, left, up


def decoding_table() -> np.ndarray:
    """:return: (256,) uint64, for every code its type, colour and state in the image, a byte each from the lowest on"""
    codes = np.arange(256, dtype=np.uint64)
    kind, colour, state = codes & TYPE_BITS, codes >> 3 & TYPE_BITS, codes >> 6
    state[WALL] = 0
    return kind | colour << 8 | state << 16
