"""
Numpy's PCG64 and the draws that Minigrid makes from it, bit for bit.

Constants are unsigned 64-bit throughout: numba turns a mix of signed and unsigned into floats.
"""

from __future__ import annotations

import numpy as np

from sb3_guide.envs.engine.compiled import compiled
from sb3_guide.envs.engine.state import World

_MULTIPLIER_HIGH, _MULTIPLIER_LOW = np.uint64(0x2360ED051FC65DA4), np.uint64(0x4385DF649FCCF645)
_LOW_HALF = np.uint64(0xFFFFFFFF)
_ZERO, _ONE, _11, _32, _58, _63 = (np.uint64(value) for value in (0, 1, 11, 32, 58, 63))
_TO_UNIT = 1.0 / (1 << 53)


@compiled
def high_product(a: np.uint64, b: np.uint64) -> np.uint64:
    """:return: the high 64 bits of the 128-bit product"""
    a_low, a_high, b_low, b_high = a & _LOW_HALF, a >> _32, b & _LOW_HALF, b >> _32
    middle = a_high * b_low + (a_low * b_low >> _32)
    other = a_low * b_high + (middle & _LOW_HALF)
    return a_high * b_high + (middle >> _32) + (other >> _32)


@compiled
def next_word(world: World) -> np.uint64:
    """:return: the next 64 bits; the waiting half word stays"""
    high, low = world.stream[0], world.stream[1]
    product = low * _MULTIPLIER_LOW
    high = high_product(low, _MULTIPLIER_LOW) + high * _MULTIPLIER_LOW + low * _MULTIPLIER_HIGH
    low = product + world.stream[3]
    high += world.stream[2] + (_ONE if low < product else _ZERO)
    world.stream[0], world.stream[1] = high, low
    turn, word = high >> _58, high ^ low
    return (word >> turn) | (word << ((_ZERO - turn) & _63))


@compiled
def next_half(world: World) -> np.uint64:
    """:return: the next 32 bits"""
    if world.has_uint32:
        world.has_uint32 = 0
        return np.uint64(world.uinteger)
    word = next_word(world)
    world.has_uint32 = 1
    world.uinteger = word >> _32
    return word & _LOW_HALF


@compiled
def draw(world: World, low: np.int64, high: np.int64) -> np.int64:
    """:return: an integer from low up to high - 1, as `Generator.integers`: Lemire's method on half words"""
    count = np.uint64(high - low)
    if count == _ONE:
        return low
    product = next_half(world) * count
    if (product & _LOW_HALF) < count:
        threshold = (_LOW_HALF - (count - _ONE)) % count
        while (product & _LOW_HALF) < threshold:
            product = next_half(world) * count
    return low + np.int64(product >> _32)


@compiled
def draw_unit(world: World) -> float:
    """:return: a float in [0, 1), as `Generator.uniform`"""
    return np.float64(next_word(world) >> _11) * _TO_UNIT


@compiled
def draw_bool(world: World) -> bool:
    """:return: Minigrid's fair coin"""
    return draw(world, 0, 2) == 0
