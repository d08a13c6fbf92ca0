"""Minigrid as the oracle, and what must be equal to it."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from minigrid.envs.babyai.core.roomgrid_level import RoomGridLevel
from minigrid.envs.babyai.core.verifier import ObjDesc, PutNextInstr


class PutNext(RoomGridLevel):
    """BabyAI's PutNext (ICLR 2019), which Minigrid does not register: PutNextLocal in a maze, objects not unique."""

    def gen_mission(self) -> None:
        """Draw the mission, in the order of the other levels with a maze."""
        self.place_agent()
        self.connect_all()
        objects = self.add_distractors(num_distractors=18, all_unique=False)
        self.check_objs_reachable()
        moved, fixed = self._rand_subset(objects, 2)
        self.instrs = PutNextInstr(ObjDesc(moved.type, moved.color), ObjDesc(fixed.type, fixed.color))


def oracle(level: str, **kwargs: Any) -> gymnasium.Env:
    """:return: Minigrid's env of the level"""
    if level == "PutNext":
        return PutNext(**kwargs)
    return gymnasium.make(f"BabyAI-{level}-v0", disable_env_checker=True, **kwargs).unwrapped


def stream(env: gymnasium.Env) -> dict[str, Any]:
    """:return: the state of an env's generator, with the buffered half word"""
    return dict(env.np_random.bit_generator.state)


def mixed_actions(rng: np.random.Generator, count: int) -> np.ndarray:
    """:return: (count,) actions of a walker that moves much and often picks up, drops and toggles"""
    return rng.choice(7, size=count, p=[0.15, 0.15, 0.34, 0.12, 0.1, 0.12, 0.02])
