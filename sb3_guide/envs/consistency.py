"""Whether a state that comes from outside is one that the compiled engine can run: it does not look at array bounds."""

from __future__ import annotations

import numpy as np

from sb3_guide.envs.engine.cells import AREA, DOOR, EMPTY, LOOK_BITS, PADDING, STRIDE, TYPE_BITS, WALL
from sb3_guide.envs.engine.state import CARRIED, GONE, MAX_CLAUSES, MAX_OBJECTS, NOTHING
from sb3_guide.envs.levels import Level
from sb3_guide.envs.vocabulary import VOCABULARY_SIZE

_RANGES = {
    "direction": (0, 3),
    "objects": (0, MAX_OBJECTS),
    "carrying": (NOTHING, MAX_OBJECTS - 1),
    "carried_before": (NOTHING, MAX_OBJECTS - 1),
    "look": (0, LOOK_BITS),
    "position": (GONE, AREA - 1),
    "tracked": (GONE, AREA - 1),
    "agent": (0, AREA - 1),
    "clauses": (0, MAX_CLAUSES),
    "second_side": (0, MAX_CLAUSES),
    "mission": (0, VOCABULARY_SIZE - 1),
}


def _out_of_range(state: dict[str, np.ndarray]) -> str | None:
    for name, (low, high) in _RANGES.items():
        if state[name].min() < low or state[name].max() > high:
            return f"{name!r} goes from {state[name].min()} to {state[name].max()}: expected {low} to {high}"
    return None


def _open_to_the_outside(cells: np.ndarray, level: Level) -> bool:
    """:return: whether there is anything but wall at the level's border or beyond it"""
    inside = np.zeros(cells.shape, dtype=np.bool_).reshape(len(cells), -1, STRIDE)
    inside[:, PADDING + 1 : PADDING + level.height - 1, 1 : level.width - 1] = True
    return bool((cells[~inside.reshape(cells.shape)] != WALL).any())


def _objects_astray(state: dict[str, np.ndarray]) -> bool:
    """:return: whether the grid and the list of objects contradict each other"""
    cells, position = state["cells"], state["position"]
    exists = np.arange(MAX_OBJECTS) < state["objects"][:, None]
    lies, carried = exists & (position >= 0), exists & (position == CARRIED)
    world, thing = np.nonzero(lies)
    if (cells[world, position[world, thing]] & LOOK_BITS != state["look"][world, thing]).any():
        return True
    if ((cells & TYPE_BITS >= DOOR).sum(axis=1) != lies.sum(axis=1)).any():
        return True
    holds = np.arange(MAX_OBJECTS) == state["carrying"][:, None]
    return bool((holds != carried).any())


def problem_of(state: dict[str, np.ndarray], level: Level) -> str | None:
    """
    Examine the values of worlds that have begun.

    :param state: arrays as of `get_state`, of the right names, shapes and dtypes
    :param level: the level that they should be of
    :return: what is wrong, or None
    """
    problem = _out_of_range(state)
    if problem or not state["max_steps"].all():
        return problem
    cells = state["cells"]
    under_agent = cells[np.arange(len(cells)), state["agent"]]
    if _open_to_the_outside(cells, level):
        return f"the walls are not those of {level.name}"
    if ((under_agent != EMPTY) & (under_agent & TYPE_BITS != DOOR)).any():
        return "an agent stands in a wall or an object"
    return "the grid contradicts the list of objects" if _objects_astray(state) else None
