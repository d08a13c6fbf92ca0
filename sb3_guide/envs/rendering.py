"""Pictures of worlds, pixel for pixel as Minigrid draws them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from sb3_guide.envs.engine.cells import (
    AHEAD,
    BALL,
    BOX,
    DOOR,
    KEY,
    LOCKED,
    OPAQUE,
    OPEN,
    PADDING,
    STRIDE,
    TYPE_BITS,
    VIEW,
    WALL,
)
from sb3_guide.envs.levels import Level

TILE = 32
_FINE = 3  # tiles are drawn so many times larger, then averaged
_NO_AGENT = 4  # instead of a direction
_SEEN = 256 * (_NO_AGENT + 1)  # added to cell + 256 * direction where the agent sees the cell
_GREY = np.array([100, 100, 100])
_COLOURS = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [112, 39, 195], [255, 255, 0], _GREY])
_BLACK, _RED, _WHITE = np.zeros(3), _COLOURS[0], np.full(3, 255)
_Y, _X = (np.indices((TILE * _FINE, TILE * _FINE)) + 0.5) / (TILE * _FINE)  # centres of the fine pixels, from 0 to 1
_MODES = (None, "rgb_array", "human")


def checked_render_mode(render_mode: str | None) -> str | None:
    """
    :param render_mode: what a user asks for
    :return: the same
    :raises ValueError: if there is no such mode
    """
    if render_mode not in _MODES:
        raise ValueError(f"render_mode={render_mode!r}: expected one of {_MODES}")
    return render_mode


def _rectangle(left: float, right: float, top: float, bottom: float) -> np.ndarray:
    return (left <= _X) & (right >= _X) & (top <= _Y) & (bottom >= _Y)


def _circle(x: float, y: float, radius: float) -> np.ndarray:
    return (_X - x) * (_X - x) + (_Y - y) * (_Y - y) <= radius * radius


def _draw_open_door(tile: np.ndarray, colour: np.ndarray) -> None:
    tile[_rectangle(0.88, 1, 0, 1)] = colour
    tile[_rectangle(0.92, 0.96, 0.04, 0.96)] = _BLACK


def _draw_closed_door(tile: np.ndarray, colour: np.ndarray) -> None:
    for inset, paint in ((0.0, colour), (0.04, _BLACK), (0.08, colour), (0.12, _BLACK)):
        tile[_rectangle(inset, 1 - inset, inset, 1 - inset)] = paint
    tile[_circle(0.75, 0.5, 0.08)] = colour


def _draw_locked_door(tile: np.ndarray, colour: np.ndarray) -> None:
    tile[:] = colour
    tile[_rectangle(0.06, 0.94, 0.06, 0.94)] = 0.45 * colour
    tile[_rectangle(0.52, 0.75, 0.5, 0.56)] = colour


def _draw_wall(tile: np.ndarray, colour: np.ndarray) -> None:
    tile[:] = colour


def _draw_key(tile: np.ndarray, colour: np.ndarray) -> None:
    tile[_rectangle(0.5, 0.63, 0.31, 0.88)] = colour
    tile[_rectangle(0.38, 0.5, 0.59, 0.66)] = colour
    tile[_rectangle(0.38, 0.5, 0.81, 0.88)] = colour
    tile[_circle(0.56, 0.28, 0.19)] = colour
    tile[_circle(0.56, 0.28, 0.064)] = _BLACK


def _draw_ball(tile: np.ndarray, colour: np.ndarray) -> None:
    tile[_circle(0.5, 0.5, 0.31)] = colour


def _draw_box(tile: np.ndarray, colour: np.ndarray) -> None:
    tile[_rectangle(0.12, 0.88, 0.12, 0.88)] = colour
    tile[_rectangle(0.18, 0.82, 0.18, 0.82)] = _BLACK
    tile[_rectangle(0.16, 0.84, 0.47, 0.53)] = colour


def _artist(cell: int) -> Callable[[np.ndarray, np.ndarray], None] | None:
    """:return: what draws the cell, None if it is empty"""
    if cell & TYPE_BITS == DOOR:
        return {OPEN: _draw_open_door, LOCKED: _draw_locked_door}.get(cell // OPAQUE, _draw_closed_door)
    return {WALL & TYPE_BITS: _draw_wall, KEY: _draw_key, BALL: _draw_ball, BOX: _draw_box}.get(cell & TYPE_BITS)


def _draw_agent(tile: np.ndarray, direction: int) -> None:
    """Draw a red triangle; inside is where the barycentric coordinates are, in Minigrid's mixed precision."""
    tip_less, tip, tip_more = (np.array(point, dtype=np.float32) for point in ((0.12, 0.19), (0.87, 0.5), (0.12, 0.81)))
    turn = -0.5 * np.pi * direction
    x, y = _X - 0.5, _Y - 0.5
    turned = np.stack([0.5 + x * np.cos(turn) - y * np.sin(turn), 0.5 + y * np.cos(turn) + x * np.sin(turn)], axis=-1)
    a, b, c = tip_more - tip_less, tip - tip_less, turned - tip_less
    scale = 1 / (a @ a * (b @ b) - a @ b * (a @ b))
    u = (b @ b * (c @ a) - a @ b * (c @ b)) * scale
    v = (a @ a * (c @ b) - a @ b * (c @ a)) * scale
    tile[(u >= 0) & (v >= 0) & (u + v < 1)] = _RED


@cache
def draw_tile(cell: int, direction: int, seen: bool) -> np.ndarray:
    """
    Draw a cell.

    :param cell: its packed code
    :param direction: the agent's direction if it stands here, else 4
    :param seen: whether the agent sees it, which makes it lighter
    :return: (32, 32, 3) uint8
    """
    tile = np.zeros((TILE * _FINE, TILE * _FINE, 3), dtype=np.uint8)
    tile[_rectangle(0, 0.031, 0, 1)] = _GREY
    tile[_rectangle(0, 1, 0, 0.031)] = _GREY
    artist = _artist(cell)
    if artist is not None:
        artist(tile, _COLOURS[cell // 8 & TYPE_BITS])
    if direction != _NO_AGENT:
        _draw_agent(tile, direction)
    if seen:
        tile = (tile + 0.3 * (_WHITE - tile)).astype(np.uint8)
    return tile.reshape(TILE, _FINE, TILE, _FINE, 3).mean(axis=3).mean(axis=1).astype(np.uint8)


def _seen_positions(world: Any, image: np.ndarray) -> np.ndarray:
    """:return: (K,) the flat positions of the cells that the agent sees"""
    ahead, right = AHEAD[world["direction"]], AHEAD[(world["direction"] + 1) % 4]
    columns, rows = np.nonzero(image[..., 0])
    return world["agent"] + ahead * (VIEW - 1 - rows) + right * (columns - VIEW // 2)


def draw_frame(world: Any, image: np.ndarray, level: Level) -> np.ndarray:
    """
    Draw a world, what the agent sees highlighted.

    :param world: record of the world
    :param image: (7, 7, 3) uint8, its present observation
    :param level: its level
    :return: (height * 32, width * 32, 3) uint8
    """
    seen = np.zeros(len(world["cells"]), dtype=np.int64)
    seen[_seen_positions(world, image)] = 1
    direction = np.full(len(seen), _NO_AGENT)
    direction[world["agent"]] = world["direction"]
    keys = world["cells"] + 256 * direction + _SEEN * seen
    keys = keys.reshape(-1, STRIDE)[PADDING : PADDING + level.height, : level.width]
    kinds, places = np.unique(keys, return_inverse=True)
    tiles = np.stack([draw_tile(kind % 256, kind % _SEEN // 256, kind >= _SEEN) for kind in kinds.tolist()])
    grid = tiles[places.reshape(keys.shape)]  # (height, width, 32, 32, 3)
    return grid.transpose(0, 2, 1, 3, 4).reshape(level.height * TILE, level.width * TILE, 3)


class Window:
    """
    A window for render mode "human".

    :param frames_per_second: how fast frames are shown at most
    :raises ImportError: if pygame is not installed
    """

    def __init__(self, frames_per_second: int) -> None:
        try:
            import pygame
        except ImportError as error:
            raise ImportError("render_mode='human' needs pygame: pip install 'sb3-guide[human]'") from error
        pygame.display.init()
        pygame.font.init()
        self._pygame = pygame
        self._frames_per_second = frames_per_second
        self._clock = pygame.time.Clock()

    def show(self, frame: np.ndarray, mission: str) -> None:
        """
        Show a frame with its mission in the window's title.

        :param frame: (height, width, 3) uint8
        :param mission: text
        """
        surface = self._pygame.surfarray.make_surface(frame.transpose(1, 0, 2))
        screen = self._pygame.display.set_mode(surface.get_size())
        self._pygame.display.set_caption(mission)
        screen.blit(surface, (0, 0))
        self._pygame.event.pump()
        self._pygame.display.flip()
        self._clock.tick(self._frames_per_second)

    def close(self) -> None:
        """Close the window."""
        self._pygame.display.quit()
