"""
The compiled entry points. They work on a range of worlds and release the GIL, so that threads can share a batch.

Numba's cache of machine code looks at the file of the function only. `_build` therefore takes a digest of all the
engine's sources into the closure of the entry points, which is part of the cache's key.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit

from sb3_guide.envs import vocabulary
from sb3_guide.envs.engine.compiled import compiled
from sb3_guide.envs.engine.dynamics import advance
from sb3_guide.envs.engine.recipes import start_episode
from sb3_guide.envs.engine.state import Rules, World
from sb3_guide.envs.engine.view import IMAGE_BYTES, observe

# Numba counts references to every array and row that it touches, by locked instructions that took half of the kernel's time.
# Without its runtime it does not count; then nothing that the entry points call can allocate memory.
_OPTIONS = {"nogil": True, "cache": True, "_nrt": False}


class Observations(NamedTuple):
    """
    Where the entry points write what the agents see, a row for every world.

    :param image: (N, 147) uint8, the (7, 7, 3) image
    :param history: (N, history * 147) uint8, the images before, oldest first
    :param mission: (N, 72) uint8
    """

    image: np.ndarray
    history: np.ndarray
    mission: np.ndarray


class Outcomes(NamedTuple):
    """
    Where a step writes how it went, a row for every world.

    :param reward: (N,) float64
    :param terminated: (N,) bool
    :param truncated: (N,) bool
    """

    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray


class EntryPoints(NamedTuple):
    """
    :param step: act, observe and, if asked, begin new episodes where the old ones ended
    :param reset: begin new episodes and observe
    :param look: write the images only
    """

    step: Callable[..., int]
    reset: Callable[..., int]
    look: Callable[..., int]


def sources_digest() -> int:
    """:return: a digest of everything in this package that the compiled code depends on"""
    files = [*sorted(Path(__file__).parent.glob("*.py")), Path(vocabulary.__file__)]
    digest = hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).digest()
    return int.from_bytes(digest[:7], "big")


@compiled
def copy_bytes(source: np.ndarray, target: np.ndarray) -> None:
    """Copy a row. Numba's own assignment of arrays is many times slower, for it looks out for overlaps."""
    for place in range(len(target)):
        target[place] = source[place]


@compiled
def show(world: World, frames: np.ndarray, index: int, out: Observations) -> None:
    """Write a world's observation; the image becomes the newest of the frames, its last `history` images."""
    copy_bytes(frames, out.history[index])
    observe(world, out.image[index])
    copy_bytes(world.mission, out.mission[index])
    if len(frames):
        copy_bytes(frames[IMAGE_BYTES:], frames[:-IMAGE_BYTES])  # forwards, so the overlap does no harm
        copy_bytes(out.image[index], frames[-IMAGE_BYTES:])


@compiled
def begin(world: World, rules: Rules, frames: np.ndarray) -> None:
    """Begin an episode: no image has been seen before the first one."""
    start_episode(world, rules)
    frames[:] = 0


def _build(digest: int) -> EntryPoints:
    """
    Define the entry points; they are compiled, or loaded, when first called.

    :param digest: of the sources
    :return: the entry points, which return the digest
    """

    @njit(**_OPTIONS)
    def step(
        start: int,
        stop: int,
        go_on: bool,
        worlds: np.ndarray,  # (N,) WORLD
        rules: np.ndarray,  # (1,) RULES
        actions: np.ndarray,  # (N,) int64
        frames: np.ndarray,  # (N, history * 147) uint8
        out: Observations,
        last: Observations,  # the last ones of the episodes that ended
        outcomes: Outcomes,
    ) -> int:
        for index in range(start, stop):
            world = worlds[index]
            reward, terminated, truncated = advance(world, actions[index])
            outcomes.reward[index], outcomes.terminated[index], outcomes.truncated[index] = reward, terminated, truncated
            if go_on and (terminated or truncated):
                show(world, frames[index], index, last)
                begin(world, rules[0], frames[index])
            show(world, frames[index], index, out)
        return digest

    @njit(**_OPTIONS)
    def reset(start: int, stop: int, worlds: np.ndarray, rules: np.ndarray, frames: np.ndarray, out: Observations) -> int:
        for index in range(start, stop):
            begin(worlds[index], rules[0], frames[index])
            show(worlds[index], frames[index], index, out)
        return digest

    @njit(**_OPTIONS)
    def look(start: int, stop: int, worlds: np.ndarray, images: np.ndarray) -> int:
        for index in range(start, stop):
            observe(worlds[index], images[index])
        return digest

    return EntryPoints(step, reset, look)


@cache
def entry_points() -> EntryPoints:
    """:return: the entry points for the sources as they are when first asked for"""
    return _build(sources_digest())
