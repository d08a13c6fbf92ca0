"""The levels of BabyAI (Chevalier-Boisvert et al. 2019), as Minigrid draws them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from sb3_guide.envs.engine.state import (
    ANYWHERE,
    BLOCKED,
    GOTO,
    LANGUAGE,
    LOCKED_ROOM,
    OPEN_DOOR,
    PICKUP,
    PUTNEXT,
    REACHABLE,
    ROOMS,
    RULES,
)

_PREFIX, _SUFFIX = "GuideGrid-", "-v0"


@dataclass(frozen=True)
class Level:
    """
    What a level's generator needs to know.

    :param name: as in BabyAI
    :param recipe: which generator: `ROOMS`, `LOCKED_ROOM` or `LANGUAGE`
    :param columns: rooms beside each other
    :param rows: rooms below each other
    :param room_size: width and height of a room in cells, both walls included
    :param distractors: how many objects are drawn (in every room, for `LOCKED_ROOM`)
    :param target: kind of the mission's clause, or the first of the kinds that may be drawn
    :param actions: how many kinds of clauses may be drawn, from `target` on (`LANGUAGE`)
    :param sentences: 1 for single clauses, 3 for clauses also joined by "and", "then" and "after" (`LANGUAGE`)
    :param access: whether objects must be `REACHABLE` without moving others, or one must be `BLOCKED`
    :param unique: whether no two objects look alike
    :param red_ball: whether the target is a red ball, drawn before the others
    :param grey: whether the other objects are grey
    :param locations: whether descriptions may say where an object is (`LANGUAGE`)
    :param unblocking: whether keys of locked doors are left out of missions (`LANGUAGE`)
    :param implicit_unlock: whether the objects of a mission may all be locked in (`LANGUAGE`)
    :param locked_room_probability: how often there is a locked room (`LANGUAGE`)
    """

    name: str
    recipe: int = ROOMS
    columns: int = 1
    rows: int = 1
    room_size: int = 8
    distractors: int = 8
    target: int = GOTO
    actions: int = 1
    sentences: int = 1
    access: int = REACHABLE
    unique: bool = False
    red_ball: bool = False
    grey: bool = False
    locations: bool = False
    unblocking: bool = False
    implicit_unlock: bool = True
    locked_room_probability: float = 0.0

    @property
    def env_id(self) -> str:
        """Gymnasium's id of the level."""
        return f"{_PREFIX}{self.name}{_SUFFIX}"

    @property
    def width(self) -> int:
        """Columns of cells."""
        return self.columns * (self.room_size - 1) + 1

    @property
    def height(self) -> int:
        """Rows of cells."""
        return self.rows * (self.room_size - 1) + 1

    def rules(self) -> np.ndarray:
        """:return: (1,) of RULES, the level as the engine takes it"""
        values = tuple(getattr(self, field.name) for field in fields(self) if field.name != "name")
        names = [field.name for field in fields(self) if field.name != "name"]
        rules = np.zeros(1, dtype=RULES)
        rules[names] = values
        return rules


_ROOM = Level("")
_MAZE = Level("", columns=3, rows=3, distractors=18)
_LANGUAGE = replace(_MAZE, recipe=LANGUAGE, access=ANYWHERE, actions=4, sentences=3, locations=True, unblocking=True)
_SYNTH = replace(_LANGUAGE, implicit_unlock=False, locked_room_probability=0.5)

#: every level by its name
LEVELS = {
    level.name: level
    for level in (
        replace(_ROOM, name="GoToObj", distractors=1, access=ANYWHERE),
        replace(_ROOM, name="GoToRedBallGrey", distractors=7, red_ball=True, grey=True),
        replace(_ROOM, name="GoToRedBall", distractors=7, red_ball=True),
        replace(_ROOM, name="GoToLocal"),
        replace(_ROOM, name="PutNextLocal", target=PUTNEXT, unique=True),
        replace(_ROOM, name="PickupLoc", recipe=LANGUAGE, target=PICKUP, locations=True),
        replace(_MAZE, name="GoToObjMaze", distractors=1),
        replace(_MAZE, name="GoTo"),
        replace(_MAZE, name="Pickup", target=PICKUP),
        replace(_MAZE, name="UnblockPickup", target=PICKUP, distractors=20, access=BLOCKED),
        replace(_MAZE, name="Open", target=OPEN_DOOR),
        replace(_MAZE, name="Unlock", recipe=LOCKED_ROOM, target=OPEN_DOOR, distractors=3),
        replace(_MAZE, name="PutNext", target=PUTNEXT),
        replace(_SYNTH, name="Synth", sentences=1, locations=False),
        replace(_SYNTH, name="SynthLoc", sentences=1),
        replace(_MAZE, name="GoToSeq", recipe=LANGUAGE, sentences=3),
        replace(_SYNTH, name="SynthSeq"),
        replace(_MAZE, name="GoToImpUnlock", recipe=LOCKED_ROOM, distractors=2),
        replace(_LANGUAGE, name="BossLevel", locked_room_probability=0.5),
        replace(_ROOM, name="PutNextLocalS5N3", target=PUTNEXT, unique=True, room_size=5, distractors=3),
        replace(_ROOM, name="PutNextLocalS6N4", target=PUTNEXT, unique=True, room_size=6, distractors=4),
        replace(_MAZE, name="GoToObjMazeS4R2", distractors=1, room_size=4, columns=2, rows=2),
        replace(_MAZE, name="GoToObjMazeS4", distractors=1, room_size=4),
        replace(_MAZE, name="GoToObjMazeS5", distractors=1, room_size=5),
        replace(_MAZE, name="GoToObjMazeS6", distractors=1, room_size=6),
        replace(_MAZE, name="GoToObjMazeS7", distractors=1, room_size=7),
        replace(_ROOM, name="GoToLocalS5N2", room_size=5, distractors=2),
        # not in BabyAI: GoTo in small mazes with few objects
        replace(_MAZE, name="GoToS4R2N3", distractors=3, room_size=4, columns=2, rows=2),
        replace(_MAZE, name="GoToS6R2N4", distractors=4, room_size=6, columns=2, rows=2),
        replace(_MAZE, name="GoToS8R2N8", distractors=8, columns=2, rows=2),
    )
}


def level_of(name: str) -> Level:
    """
    Find a level.

    :param name: "GoToObj" or "GuideGrid-GoToObj-v0"
    :return: the level
    :raises ValueError: if there is no such level
    """
    level = LEVELS.get(name.removeprefix(_PREFIX).removesuffix(_SUFFIX))
    if level is None or name not in (level.name, level.env_id):
        raise ValueError(f"unknown level {name!r}: expected an id such as GuideGrid-GoToObj-v0, or one of {', '.join(LEVELS)}")
    return level
