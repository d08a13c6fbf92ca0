"""
Compiled: find equal rows, number cells, add up rows. Torch sorts for the first and needs a dozen operators for the second.
"""

from typing import Any

import numpy as np
import torch as th
from numba import njit

OPTIONS: dict[str, Any] = {"nogil": True, "cache": True}


def is_plain(*parts: th.Tensor) -> bool:
    """:return: whether numpy can read these tensors: they are on the CPU, and nobody asks for their gradients or traces"""
    plain = all(type(part) is th.Tensor and part.device.type == "cpu" and not part.requires_grad for part in parts)
    return plain and not th.jit.is_tracing()


@njit(**OPTIONS)
def distinct_rows(rows: np.ndarray, more: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    A hash table of rows, which are compared whole where their hashes meet.

    :param rows: (N, D) int64
    :param more: (N, E) int64, further columns of the same rows
    :return: index of the first of each distinct row (U,), and for every row which of them it equals (N,)
    """
    size = 2
    while size < 2 * len(rows):
        size *= 2
    slots = np.full(size, -1, np.int64)  # position in first
    first, position = np.empty(len(rows), np.int64), np.empty(len(rows), np.int64)
    count = 0
    for row in range(len(rows)):
        mixed = np.uint64(0)
        for value in rows[row]:
            mixed = (mixed ^ np.uint64(value)) * np.uint64(0x9E3779B97F4A7C15)
        for value in more[row]:
            mixed = (mixed ^ np.uint64(value)) * np.uint64(0x9E3779B97F4A7C15)
        slot = np.int64(mixed >> np.uint64(32)) & (size - 1)
        while slots[slot] >= 0:
            other = first[slots[slot]]
            if equal(rows[row], rows[other]) and equal(more[row], more[other]):
                break
            slot = (slot + 1) & (size - 1)
        if slots[slot] < 0:
            slots[slot], first[count] = count, row
            count += 1
        position[row] = slots[slot]
    return first[:count].copy(), position


@njit(**OPTIONS)
def equal(one: np.ndarray, other: np.ndarray) -> bool:
    """:return: whether two rows are"""
    for place in range(len(one)):  # noqa: SIM110  numba knows no all()
        if one[place] != other[place]:
            return False
    return True


@njit(**OPTIONS)
def number_cells(cells: np.ndarray, counts: np.ndarray, numbers: np.ndarray) -> bool:
    """
    Write the channels of each cell as one number.

    :param cells: (N, C) uint8 or float32
    :param counts: (C,) int64, how many values each channel can take
    :param numbers: (N,) int64
    :return: False if a cell has another value
    """
    for cell in range(len(cells)):
        number = 0
        for channel in range(len(counts)):
            value = int(cells[cell, channel])
            if value != cells[cell, channel] or not 0 <= value < counts[channel]:
                return False
            number = number * counts[channel] + value
        numbers[cell] = number
    return True


@njit(**OPTIONS)
def add_rows(rows: np.ndarray, index: np.ndarray, total: np.ndarray) -> None:
    """
    Add up rows that belong together, one after the other.

    :param rows: (N, D) float32
    :param index: (N,) int64, to which row of the total each is added
    :param total: (R, D) float32
    """
    for row in range(len(rows)):
        for place in range(rows.shape[1]):
            total[index[row], place] += rows[row, place]
