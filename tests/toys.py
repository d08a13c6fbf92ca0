"""Environments that are not ours."""

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces


class Pick(gymnasium.Env):
    """Two cells of different colours, of which the mission names one: take it, three times in a row."""

    action_names = ("left", "right")

    def __init__(self) -> None:
        image, mission = spaces.Box(0, 2, (1, 2, 1), np.uint8), spaces.Box(0, 2, (1,), np.uint8)
        self.observation_space = spaces.Dict({"image": image, "mission": mission})
        self.action_space = spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        self.wanted, self.taken = self.np_random.integers(1, 3, 1, np.uint8), 0
        return self._show(), {}

    def step(self, action):
        right = self.cells[action] == self.wanted[0]
        self.taken += right
        return self._show(), float(self.taken == 3), bool(self.taken == 3 or not right), False, {}

    def _show(self):
        self.cells = self.np_random.permutation(np.arange(1, 3, dtype=np.uint8))
        return {"image": self.cells.reshape(1, 2, 1), "mission": self.wanted}


class Signal(gymnasium.Env):
    """The image says which action is right, all but the first one of an episode, which is blank."""

    spaces_by_kind: ClassVar[dict[str, spaces.Box]] = {
        "cells": spaces.Box(0, 3, (3, 5, 2), np.uint8),
        "many kinds": spaces.Box(0, 9, (4, 4, 6), np.int64),
        "flags": spaces.Box(0, 1, (6, 6, 4), np.bool_),
        "bytes": spaces.Box(0, 255, (5, 5, 3), np.uint8),
        "pixels": spaces.Box(0, 255, (36, 48, 3), np.uint8),
        "floats": spaces.Box(0, 1, (12, 10, 1), np.float32),
    }

    def __init__(self, kind: str = "cells", words: int = 0, length: int = 4) -> None:
        image = self.spaces_by_kind[kind]
        self.observation_space = spaces.Dict({"image": image})
        if words:
            self.observation_space["mission"] = spaces.Box(0, words, (3,), np.uint8)
        self.action_space = spaces.Discrete(4)
        self.action_names = ("north", "east", "south", "west")
        self.length = length

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        self.right, self.steps = int(self.np_random.integers(4)), 0
        return self._see(), {}

    def step(self, action):
        correct = int(action) == self.right and self.steps > 0
        self.steps += 1
        return self._see(), float(correct), correct, self.steps == self.length, {}

    def _see(self):
        image = self.observation_space["image"]
        picture = np.zeros(image.shape, image.dtype)
        if self.steps:
            picture[self.right % picture.shape[0], self.right // picture.shape[0]] = image.high.max()
        seen = {"image": picture}
        if "mission" in self.observation_space.spaces:
            seen["mission"] = np.array([self.right + 1, 1, 0], np.uint8)
        return seen


for env_id, toy in (("Pick-v0", Pick), ("Signal-v0", Signal)):
    if env_id not in gymnasium.registry:
        gymnasium.register(env_id, toy)
