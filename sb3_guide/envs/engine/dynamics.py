"""A step of the world: the agent's action and the verifier of the mission."""

from __future__ import annotations

import numpy as np

from sb3_guide.envs.engine.cells import AHEAD, BOX, CLOSED, DOOR, EMPTY, KEY, LOCKED, OPAQUE, OPEN, TYPE_BITS
from sb3_guide.envs.engine.compiled import compiled
from sb3_guide.envs.engine.missions import contains
from sb3_guide.envs.engine.rooms import distance
from sb3_guide.envs.engine.state import AFTER, ALONE, CARRIED, GONE, GOTO, MAX_OBJECTS, NOTHING, OPEN_DOOR, PICKUP, World

_ZERO = np.uint64(0)
_LEFT, _RIGHT, _FORWARD, _PICKUP, _DROP, _TOGGLE = range(6)


@compiled
def thing_at(world: World, position: int) -> int:
    """:return: the object that lies there, which must exist"""
    thing = 0
    while world.position[thing] != position:
        thing += 1
    return thing


@compiled
def toggle(world: World, front: int) -> None:
    """Open or close a door, with the key if it is locked; open a box, which is empty and vanishes."""
    cell = world.cells[front]
    if cell & TYPE_BITS == BOX:
        world.position[thing_at(world, front)] = GONE
        world.cells[front] = EMPTY
    elif cell & TYPE_BITS == DOOR:
        look, state = cell % OPAQUE, cell // OPAQUE
        if state != LOCKED:
            world.cells[front] = look + (OPEN if state == CLOSED else CLOSED) * OPAQUE
        elif world.carrying != NOTHING and world.look[world.carrying] == look - DOOR + KEY:
            world.cells[front] = look + OPEN * OPAQUE


@compiled
def track(world: World) -> None:
    """Let the verifier look where the objects are."""
    for thing in range(world.objects):
        world.tracked[thing] = world.position[thing]


@compiled
def act(world: World, action: int) -> None:
    """Carry out an action, numbered as in Minigrid; `done` does nothing."""
    front = world.agent + AHEAD[world.direction]
    cell = world.cells[front]
    kind = cell & TYPE_BITS
    if action == _LEFT:
        world.direction = (world.direction + 3) % 4
    elif action == _RIGHT:
        world.direction = (world.direction + 1) % 4
    elif action == _FORWARD:
        if cell == EMPTY or (kind == DOOR and cell < OPAQUE):
            world.agent = front
    elif action == _PICKUP:
        if kind >= KEY and world.carrying == NOTHING:
            world.carrying = thing_at(world, front)
            world.position[world.carrying] = CARRIED
            world.cells[front] = EMPTY
    elif action == _DROP:
        if cell == EMPTY and world.carrying != NOTHING:
            world.cells[front] = world.look[world.carrying]
            world.position[world.carrying] = front
            world.carrying = NOTHING
        track(world)
    elif action == _TOGGLE:
        toggle(world, front)


@compiled
def faces_target(world: World, clause: int, front: int) -> bool:
    """:return: whether the verifier believes that an object of the clause lies in front"""
    there = _ZERO
    for thing in range(MAX_OBJECTS):  # all that there could be: a loop of fixed length becomes a few wide instructions
        there |= np.uint64(world.tracked[thing] == front) << np.uint64(thing)
    return there & world.targets[clause, 0] != _ZERO


@compiled
def opened_target(world: World, clause: int, front: int) -> bool:
    """:return: whether a door of the clause stands open in front"""
    cell = world.cells[front]
    if cell & TYPE_BITS != DOOR or cell >= OPAQUE:
        return False
    return contains(world.targets[clause, 0], thing_at(world, front))


@compiled
def put_next(world: World, clause: int, moved: int) -> bool:
    """:return: whether the object that was carried lies next to a fixed object"""
    if moved == NOTHING or not contains(world.targets[clause, 0], moved):
        return False
    for thing in range(world.objects):
        fixed = world.tracked[thing]
        if fixed >= 0 and contains(world.targets[clause, 1], thing) and distance(world.position[moved], fixed) == 1:
            return True
    return False


@compiled
def verify_clause(world: World, clause: int, action: int) -> bool:
    """:return: whether the action completes the clause"""
    kind = world.kind[clause]
    front = world.agent + AHEAD[world.direction]
    if kind == GOTO:
        return faces_target(world, clause, front)
    if kind == OPEN_DOOR:
        return action == _TOGGLE and opened_target(world, clause, front)
    before, now = world.carried_before[clause], world.carrying
    world.carried_before[clause] = now
    if kind == PICKUP:
        return action == _PICKUP and before == NOTHING and now != NOTHING and contains(world.targets[clause, 0], now)
    return action == _DROP and put_next(world, clause, before)


@compiled
def verify_side(world: World, first: int, stop: int, action: int) -> bool:
    """:return: whether all clauses from first up to stop - 1 are done, in any order"""
    done = True
    for clause in range(first, stop):
        if not world.done[clause]:
            world.done[clause] = verify_clause(world, clause, action)
        done &= world.done[clause] != 0
    return done


@compiled
def verify(world: World, action: int) -> bool:
    """:return: whether the action completes the mission; one action may complete both sides"""
    split, end = world.second_side, world.clauses
    if world.connective == ALONE:
        return verify_side(world, 0, end, action)
    if not world.first_done:
        first, stop = (split, end) if world.connective == AFTER else (0, split)
        world.first_done = verify_side(world, first, stop, action)
    if not world.first_done:
        return False
    first, stop = (0, split) if world.connective == AFTER else (split, end)
    return verify_side(world, first, stop, action)


@compiled
def advance(world: World, action: int) -> tuple[float, bool, bool]:
    """:return: reward, terminated, truncated after the action"""
    world.steps += 1
    act(world, action)
    success = verify(world, action)
    reward = 1 - 0.9 * (world.steps / world.max_steps) if success else 0.0
    return reward, success, world.steps >= world.max_steps
