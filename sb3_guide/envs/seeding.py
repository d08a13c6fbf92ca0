"""Numpy's way from a seed to the state of a PCG64, for many seeds at once."""

from __future__ import annotations

import numpy as np

HIGHEST_SEED = (1 << 64) - 1

_POOL = 4  # words of 32 bits
_MIX, _SUBTRACT = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
_MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645  # of PCG64
_WORD, _STATE = (1 << 64) - 1, (1 << 128) - 1


def _powers(first: int, factor: int, count: int) -> np.ndarray:
    """:return: (count + 1,) uint32, the first number and what repeated multiplication makes of it"""
    return np.array([first * pow(factor, power, 1 << 32) % (1 << 32) for power in range(count + 1)], dtype=np.uint32)


_SCRAMBLING = _powers(0x43B0D7E5, 0x931E8875, _POOL * _POOL)
_GENERATION = _powers(0x8B51F9DD, 0x58F38DED, 2 * _POOL)


def _hashed(words: np.ndarray, constants: np.ndarray, use: int) -> np.ndarray:
    words = (words ^ constants[use]) * constants[use + 1]
    return words ^ words >> 16


def _mixed(words: np.ndarray, others: np.ndarray) -> np.ndarray:
    mixed: np.ndarray = words * _MIX - others * _SUBTRACT
    return mixed ^ mixed >> 16


def _entropy(seeds: np.ndarray) -> list[np.ndarray]:
    """:return: 8 words (N,) uint32, `SeedSequence(seed).generate_state(8)` of every seed"""
    words = seeds.astype("<u8").view("<u4").reshape(-1, 2)
    words = np.pad(words, ((0, 0), (0, _POOL - 2)))
    pool = [_hashed(words[:, place], _SCRAMBLING, place) for place in range(_POOL)]
    use = _POOL
    for source in range(_POOL):
        for target in range(_POOL):
            if source != target:
                pool[target] = _mixed(pool[target], _hashed(pool[source], _SCRAMBLING, use))
                use += 1
    return [_hashed(pool[place % _POOL], _GENERATION, place) for place in range(2 * _POOL)]


def streams(seeds: np.ndarray) -> np.ndarray:
    """
    Seed generators as `PCG64(SeedSequence(seed))` does.

    :param seeds: (N,) uint64
    :return: (N, 4) uint64, high and low word of the state, high and low word of the increment
    """
    words = [word.astype(object) for word in _entropy(seeds)]  # Python's integers, for they have 128 bits
    state, sequence = (words[at + 1] << 96 | words[at] << 64 | words[at + 3] << 32 | words[at + 2] for at in (0, 4))
    increment = (sequence << 1 | 1) & _STATE
    state = ((state + increment) * _MULTIPLIER + increment) & _STATE
    parts = [part for number in (state, increment) for part in (number >> 64, number & _WORD)]
    return np.stack(parts, axis=1).astype(np.uint64)
