"""A batch of worlds of one level: what the Gymnasium env and the SB3 VecEnv have in common."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from sb3_guide.envs.compiling import first_call
from sb3_guide.envs.consistency import problem_of
from sb3_guide.envs.engine.cells import PADDING, STRIDE
from sb3_guide.envs.engine.kernel import Observations, Outcomes, entry_points
from sb3_guide.envs.engine.state import WORLD
from sb3_guide.envs.engine.view import IMAGE_BYTES
from sb3_guide.envs.levels import Level, level_of
from sb3_guide.envs.rendering import draw_frame
from sb3_guide.envs.seeding import HIGHEST_SEED, streams
from sb3_guide.envs.spaces import ACTIONS, IMAGE_SHAPE
from sb3_guide.envs.vocabulary import MISSION_LENGTH, decode

Observation: TypeAlias = dict[str, np.ndarray]

_WORD = (1 << 64) - 1
MAX_WORLDS, MAX_IMAGES = 2**18, 2**20  # in a batch; the images are those that all its worlds remember


class Batch:
    """
    Worlds of one level, in arrays.

    :param level: the level
    :param size: how many worlds
    :param history: how many images before the present one an observation holds
    :param n_threads: how many threads share the work of a step
    :raises ValueError: if a number is out of range
    """

    def __init__(self, level: Level, size: int, history: int, n_threads: int = 1) -> None:
        if not 1 <= size <= MAX_WORLDS:
            raise ValueError(f"n_envs={size}: expected 1 to {MAX_WORLDS} worlds")
        if not 0 <= history < MAX_IMAGES // size:
            raise ValueError(f"history={history} in {size} worlds: expected 0 to {MAX_IMAGES // size - 1} images")
        if n_threads < 1:
            raise ValueError(f"n_threads={n_threads}: expected at least one thread")
        self.level = level
        self.size = size
        self.history = history
        threads = min(n_threads, size)
        self._shares = list(pairwise(size * share // threads for share in range(threads + 1)))
        self.worlds = np.zeros(size, dtype=WORLD)
        self._rules = level.rules()
        self._frames = np.zeros((size, history * IMAGE_BYTES), dtype=np.uint8)  # the present image is the newest
        self._last = self._new_observations()  # a row holds what was seen when its world's last episode ended
        self._started = False
        self._threads: ThreadPoolExecutor | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_threads": None}

    def seed(self, seeds: Sequence[int | None]) -> None:
        """
        Start random streams anew.

        :param seeds: for every world as for a Gymnasium env; None goes on, with entropy from the system if it is the first
        :raises ValueError: if there is not one for every world, or one is negative or has more than 64 bits
        """
        given = [seed for seed in seeds if seed is not None]
        valid = all(isinstance(seed, (int, np.integer)) and 0 <= seed <= HIGHEST_SEED for seed in given)
        if len(seeds) != self.size or not valid:
            raise ValueError(f"seeds={seeds}: expected {self.size} non-negative integers of at most 64 bits")
        seeded = np.array([seed is not None for seed in seeds])
        values = np.random.SeedSequence().generate_state(self.size, np.uint64)
        values[seeded] = given
        chosen = seeded | ~self.worlds["stream"].any(axis=1)
        self.worlds["stream"][chosen] = streams(values[chosen])
        self.worlds["has_uint32"][chosen] = 0
        self.worlds["uinteger"][chosen] = 0

    def set_level(self, level: Level) -> None:
        """
        Change the level, random streams going on. The worlds must be reset next.

        :param level: the level
        """
        self.level = level
        self._rules = level.rules()
        self._started = False

    def generator(self, index: int) -> np.random.Generator:
        """:return: a generator at the present state of a world's random stream"""
        world = self.worlds[index]
        high, low, increment_high, increment_low = (int(word) for word in world["stream"])
        bits = np.random.PCG64()
        bits.state = {
            "bit_generator": "PCG64",
            "state": {"state": high << 64 | low, "inc": increment_high << 64 | increment_low},
            "has_uint32": int(world["has_uint32"]),
            "uinteger": int(world["uinteger"]),
        }
        return np.random.Generator(bits)

    def set_generator(self, index: int, generator: np.random.Generator) -> None:
        """
        Take over a generator's state as a world's random stream.

        :param index: which world
        :param generator: a generator of PCG64, as Gymnasium makes them
        :raises ValueError: if it is another one
        """
        state: Any = generator.bit_generator.state
        if state["bit_generator"] != "PCG64":
            raise ValueError(f"the generator is a {state['bit_generator']}: expected a PCG64, as Gymnasium makes")
        words = state["state"]["state"], state["state"]["inc"]
        self.worlds["stream"][index] = [part for word in words for part in (word >> 64, word & _WORD)]
        self.worlds["has_uint32"][index] = state["has_uint32"]
        self.worlds["uinteger"][index] = state["uinteger"]

    def reset(self) -> Observation:
        """
        Begin new episodes in all worlds.

        :return: the observations, in new arrays
        """
        out = self._new_observations()
        self._run(entry_points().reset, self.worlds, self._rules, self._frames, out)
        self._started = True
        return self._named(out)

    def step(self, actions: np.ndarray, go_on: bool) -> tuple[Observation, np.ndarray, np.ndarray, np.ndarray]:
        """
        Act in all worlds.

        :param actions: (size,) integers from 0 to 6
        :param go_on: whether worlds whose episode ended begin a new one
        :return: the observations, (size,) float64 rewards, (size,) bool terminated and truncated, in new arrays
        :raises ValueError: if the actions are not valid, or the worlds were never reset
        """
        actions, out = self._checked(actions), self._new_observations()
        outcomes = Outcomes(np.empty(self.size), np.empty(self.size, dtype=np.bool_), np.empty(self.size, dtype=np.bool_))
        step = entry_points().step
        self._run(step, go_on, self.worlds, self._rules, actions, self._frames, out, self._last, outcomes)
        return self._named(out), *outcomes

    def last_observations(self, indices: np.ndarray) -> list[Observation]:
        """:return: what the worlds at these indices showed at the end of their last episodes"""
        last = self._named(Observations(*(rows.take(indices, axis=0) for rows in self._last)))
        pairs = zip(last["image"], last["mission"], strict=True)
        observations: list[Observation] = [{"image": image, "mission": mission} for image, mission in pairs]
        for observation, history in zip(observations, last.get("history", ()), strict=False):
            observation["history"] = history
        return observations

    def mission(self, index: int) -> str:
        """:return: a world's mission as text"""
        return decode(self.worlds["mission"][index])

    def place(self, index: int) -> tuple[int, int, int]:
        """:return: column, row and direction of a world's agent"""
        row, column = divmod(int(self.worlds["agent"][index]), STRIDE)
        return column, row - PADDING, int(self.worlds["direction"][index])

    def picture(self, index: int) -> np.ndarray:
        """:return: (height * 32, width * 32, 3) uint8, a world with the agent's view highlighted"""
        if not self._started:
            raise ValueError("a picture before the first reset: call reset() first")
        image = np.empty((1, IMAGE_BYTES), dtype=np.uint8)
        entry_points().look(0, 1, self.worlds[index : index + 1], image)
        return draw_frame(self.worlds[index], image.reshape(IMAGE_SHAPE), self.level)

    def get_state(self) -> dict[str, np.ndarray]:
        """:return: copies of everything that the worlds' future depends on, by name; all arrays are (size, ...)"""
        return {**{name: self.worlds[name].copy() for name in self._names()}, "frames": self._frames.copy()}

    def set_state(self, state: dict[str, np.ndarray]) -> None:
        """
        Take over a state of `get_state`, of the same level, size and history.

        :param state: the arrays by name
        :raises ValueError: if names, shapes, dtypes or values are not possible; the worlds are unchanged then
        """
        own = self.get_state()
        if set(state) != set(own):
            raise ValueError(f"the state's arrays are named {sorted(state)}: expected {sorted(own)}")
        for name, array in state.items():
            if array.shape != own[name].shape or array.dtype != own[name].dtype:
                raise ValueError(
                    f"the state's {name!r} is {array.dtype}{array.shape}: expected {own[name].dtype}{own[name].shape}, "
                    "as get_state gives it for this level, number of worlds and history"
                )
        problem = problem_of(state, self.level)
        if problem:
            raise ValueError(f"the state cannot be one of {self.level.name}: {problem}")
        for name in self._names():
            self.worlds[name] = state[name]
        self._frames[:] = state["frames"]
        self._started = bool((self.worlds["max_steps"] > 0).all())

    @staticmethod
    def _names() -> tuple[str, ...]:
        return WORLD.names or ()

    def _checked(self, actions: np.ndarray) -> np.ndarray:
        actions = np.asarray(actions)
        if actions.shape != (self.size,) or not np.issubdtype(actions.dtype, np.integer):
            raise ValueError(f"actions are {actions.dtype}{actions.shape}: expected integers of shape ({self.size},)")
        actions = np.ascontiguousarray(actions, dtype=np.int64)
        if actions.view(np.uint64).max() >= len(ACTIONS):  # the negative ones are the highest now
            raise ValueError(f"actions from {actions.min()} to {actions.max()}: expected 0 to {len(ACTIONS) - 1}")
        if not self._started:
            raise ValueError("a step before the first reset: call reset() first")
        return actions

    def _new_observations(self) -> Observations:
        return Observations(
            np.empty((self.size, IMAGE_BYTES), dtype=np.uint8),
            np.empty((self.size, self.history * IMAGE_BYTES), dtype=np.uint8),
            np.empty((self.size, MISSION_LENGTH), dtype=np.uint8),
        )

    def _named(self, rows: Observations) -> Observation:
        members = {"image": rows.image.reshape(-1, *IMAGE_SHAPE), "mission": rows.mission}
        if self.history:
            members["history"] = rows.history.reshape(-1, self.history, *IMAGE_SHAPE)
        return members

    def _run(self, entry_point: Any, *arguments: Any) -> None:
        """Call an entry point for all worlds, in equal shares for the threads, of which the caller is one."""
        own, *others = self._shares
        with nullcontext() if entry_point.overloads else first_call(entry_point):
            running = [self._pool().submit(entry_point, *share, *arguments) for share in others]
            entry_point(*own, *arguments)
            for share in running:
                share.result()

    def _pool(self) -> ThreadPoolExecutor:
        if self._threads is None:
            self._threads = ThreadPoolExecutor(len(self._shares) - 1)
        return self._threads


def compile_engine() -> None:
    """Call every entry point once, so that all of the engine is in numba's cache."""
    batch = Batch(level_of("GoToObj"), size=1, history=0)
    batch.seed([0])
    batch.reset()
    batch.step(np.zeros(1, dtype=np.int64), go_on=True)
    batch.picture(0)
