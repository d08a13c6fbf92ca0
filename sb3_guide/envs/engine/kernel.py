"""
The compiled entry points. They work on a range of worlds and release the GIL, so that threads can share a batch.

Numba's cache of machine code looks at the file of the function only. `entry_points` therefore takes a digest of all the
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
from sb3_guide.envs.engine.dynamics import advance
from sb3_guide.envs.engine.recipes import start_episode
from sb3_guide.envs.engine.state import Rules
from sb3_guide.envs.engine.view import IMAGE_BYTES, observe


class Observations(NamedTuple):
    """
    Where the entry points write.

    :param image: (N, 7, 7, 3) uint8
    :param history: (N, history, 7, 7, 3) uint8, the images before, oldest first
    :param mission: (N, 72) uint8
    """

    image: np.ndarray
    history: np.ndarray
    mission: np.ndarray


class EntryPoints(NamedTuple):
    """
    :param step: act, observe and, if asked, begin new episodes where the old ones ended
    :param reset: begin new episodes in the chosen worlds, and observe
    """

    step: Callable[..., None]
    reset: Callable[..., None]


def sources_digest() -> str:
    """:return: a digest of everything that the compiled code depends on in this package"""
    files = [*sorted(Path(__file__).parent.glob("*.py")), Path(vocabulary.__file__)]
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


@njit
def begin(worlds: np.ndarray, index: int, rules: Rules, frames: np.ndarray) -> None:
    """Begin an episode: no image has been seen before the first one."""
    start_episode(worlds[index], rules)
    frames[index] = 0
    observe(worlds[index], frames[index, -1])


@njit
def shift(frames: np.ndarray) -> None:
    """Forget the oldest frame; the newest one is doubled until it is overwritten."""
    bytes_in_order = frames.reshape(-1)
    for place in range(len(bytes_in_order) - IMAGE_BYTES):
        bytes_in_order[place] = bytes_in_order[place + IMAGE_BYTES]


@njit
def publish(worlds: np.ndarray, index: int, frames: np.ndarray, seen: Observations) -> None:
    """Copy a world's observation to where the caller keeps it."""
    seen.image[index] = frames[index, -1]
    seen.history[index] = frames[index, :-1]
    seen.mission[index] = worlds[index].mission


@cache
def entry_points(sources: str) -> EntryPoints:
    """
    Compile, or load what is cached, when first called with arrays.

    :param sources: what `sources_digest` returns
    :return: the entry points
    """

    @njit(nogil=True, cache=True)
    def step(
        start: int,
        stop: int,
        go_on: bool,
        worlds: np.ndarray,
        rules: np.ndarray,
        actions: np.ndarray,
        frames: np.ndarray,
        last_frames: np.ndarray,
        seen: Observations,
    ) -> str:
        for index in range(start, stop):
            world = worlds[index]
            advance(world, actions[index])
            shift(frames[index])
            observe(world, frames[index, -1])
            if go_on and (world.terminated or world.truncated):
                last_frames[index] = frames[index]
                world.last_mission[:] = world.mission
                begin(worlds, index, rules[0], frames)
            publish(worlds, index, frames, seen)
        return sources

    @njit(nogil=True, cache=True)
    def reset(
        start: int,
        stop: int,
        chosen: np.ndarray,
        worlds: np.ndarray,
        rules: np.ndarray,
        frames: np.ndarray,
        seen: Observations,
    ) -> str:
        for index in range(start, stop):
            if chosen[index]:
                begin(worlds, index, rules[0], frames)
            publish(worlds, index, frames, seen)
        return sources

    return EntryPoints(step, reset)
