"""Minigrid as the oracle, and what must be equal to it."""

from __future__ import annotations

from contextlib import redirect_stdout
from io import StringIO
from typing import Any

import gymnasium
import numpy as np

from sb3_guide.envs import GuideGridEnv
from sb3_guide.envs.bot import twin


def stream(env: gymnasium.Env) -> dict[str, Any]:
    """:return: the state of an env's generator, with the buffered half word"""
    return dict(env.np_random.bit_generator.state)


def mixed_actions(rng: np.random.Generator, count: int) -> np.ndarray:
    """:return: (count,) actions of a walker that moves much and often picks up, drops and toggles"""
    return rng.choice(7, size=count, p=[0.15, 0.15, 0.34, 0.12, 0.1, 0.12, 0.02])


class Twins:
    """
    Minigrid's env of a level and ours, kept in step.

    :param level: name of the level
    """

    def __init__(self, level: str) -> None:
        self.theirs = twin(level)
        self.ours = GuideGridEnv(level, history=0)

    def reset(self, **kwargs: int) -> str | None:
        """
        Reset both.

        :param kwargs: a seed, or nothing
        :return: what differs then, or None
        """
        with redirect_stdout(StringIO()):  # Minigrid prints every grid that it rejects
            expected, _ = self.theirs.reset(**kwargs)
        return self._difference(expected["image"], self.ours.reset(**kwargs)[0]["image"])

    def step(self, action: int) -> tuple[str | None, bool, bool]:
        """
        Act in both.

        :param action: number of the action
        :return: what differs then, or None; whether the mission is accomplished; whether the episode is over
        """
        expected, *outcome, _ = self.theirs.step(action)
        observation, *own_outcome, _ = self.ours.step(action)
        difference = self._difference(expected["image"], observation["image"])
        if outcome != own_outcome:
            difference = f"reward, terminated, truncated: {outcome} against our {own_outcome}"
        return difference, outcome[1], any(outcome[1:])

    def _difference(self, image: np.ndarray, own_image: np.ndarray) -> str | None:
        pairs = {
            "image": (image.tolist(), own_image.tolist()),
            "direction": (int(self.theirs.agent_dir), int(self.ours.get_state()["direction"][0])),
            "mission": (self.theirs.mission, self.ours.mission),
            "generator": (stream(self.theirs), stream(self.ours)),
        }
        return next((f"{name}: {wanted} against our {got}" for name, (wanted, got) in pairs.items() if wanted != got), None)


def first_difference(level: str, seed: int, steps: int) -> str | None:
    """
    Play the same actions in both, with a seeded reset at first and unseeded ones after each episode.

    :param level: name of the level
    :param seed: of the level and of the actions
    :param steps: how many
    :return: what differed first, or None
    """
    twins = Twins(level)
    difference, over = twins.reset(seed=seed), False
    for step, action in enumerate(mixed_actions(np.random.default_rng(seed), steps)):
        if over:
            difference = twins.reset()
        if not difference:
            difference, _, over = twins.step(action)
        if difference:
            return f"{level}, seed {seed}, step {step}: {difference}"
    return None
