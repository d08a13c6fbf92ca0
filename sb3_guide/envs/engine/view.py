"""What the agent sees: the 7 x 7 cells in front of it, rotated so that it looks up, with what walls and doors hide."""

from __future__ import annotations

import numpy as np

from sb3_guide.envs.engine.cells import AHEAD, EMPTY, OPAQUE, VIEW, decoding_table
from sb3_guide.envs.engine.compiled import compiled
from sb3_guide.envs.engine.state import NOTHING, World

_DECODED = decoding_table()
_MIDDLE = VIEW // 2
_ONE, _TWO, _8, _16 = (np.uint64(value) for value in (1, 2, 8, 16))
IMAGE_BYTES = VIEW * VIEW * 3


def _spreading_table() -> np.ndarray:
    """
    Light enters a row of the view at some columns, spreads to both sides through clear cells, and goes on from every clear
    cell to the three cells in front of it; Minigrid's sweep leaves out the last cell in its direction.

    :return: (128, 128) int16, for the columns entered and the columns clear (bit i is column i): the columns seen in this
        row, and from bit 7 on the columns entered in the next row
    """
    entered, clear = np.meshgrid(np.arange(1 << VIEW), np.arange(1 << VIEW), indexing="ij")
    seen, onward = entered.copy(), np.zeros_like(entered)
    sweeps = [(column, 1) for column in range(VIEW - 1)] + [(column, -1) for column in range(VIEW - 1, 0, -1)]
    for column, step in sweeps:
        shines = (seen & clear) >> column & 1
        seen |= shines << column + step
        onward |= shines << column | shines << column + step
    return (seen | onward << VIEW).astype(np.int16)


_SPREAD = _spreading_table()


@compiled
def write_cell(image: np.ndarray, column: int, row: int, cell: np.uint64) -> None:
    """Write type, colour and state of a cell. Numba is faster with unsigned indices, which cannot count from the end."""
    decoded = _DECODED[cell]
    place = np.uint64((column * VIEW + row) * 3)
    image[place] = decoded
    image[place + _ONE] = decoded >> _8
    image[place + _TWO] = decoded >> _16


@compiled
def observe(world: World, image: np.ndarray) -> None:
    """
    Write the agent's view, row by row away from the agent, as far as light comes.

    :param image: (147,) uint8 in order of column, row, and (type, colour, state); the agent is at column 3 of row 6
    """
    image[:] = 0
    ahead, right = AHEAD[world.direction], AHEAD[(world.direction + 1) % 4]
    left_end = world.agent - right * _MIDDLE
    row, entered = VIEW - 1, 1 << _MIDDLE
    while row >= 0 and entered:
        clear = 0
        for column in range(VIEW):
            clear |= (world.cells[np.uint64(left_end + right * column)] < OPAQUE) << column
        light = _SPREAD[np.uint64(entered), np.uint64(clear)]
        for column in range(VIEW):
            if light >> column & 1:
                write_cell(image, column, row, np.uint64(world.cells[np.uint64(left_end + right * column)]))
        entered = light >> VIEW
        left_end += ahead
        row -= 1
    held = EMPTY if world.carrying == NOTHING else world.look[world.carrying]
    write_cell(image, _MIDDLE, VIEW - 1, np.uint64(held))
