"""Where episodes take place: levels of ours, which tell their exact state, and other environments, which are played again."""

from typing import Any, Literal, NamedTuple, Protocol

import gymnasium
import numpy as np
from gymnasium import spaces

from sb3_guide.envs import GuideGridEnv, decode, encode, is_level
from sb3_guide.envs.engine.cells import BALL, BOX, COLOURS, KEY, VIEW
from sb3_guide.envs.given_mission import has_targets, with_mission
from sb3_guide.language.animation import drawn
from sb3_guide.playground.pictures import draw_image, draw_view
from sb3_guide.policies.picture import picture_of
from sb3_guide.policies.sequences import history_of

LOST = "Something that the mission speaks of is not there, so that it can't be fulfilled."
THINGS = {KEY: "key", BALL: "ball", BOX: "box"}

Observation = dict[str, np.ndarray]
Outcome = Literal["", "fulfilled", "out of time", "failed"]


class Captions(NamedTuple):
    """
    :param world: what is written beneath the picture of the world
    :param view: what is written beneath the picture of what the agent sees
    """

    world: str
    view: str


class Scene(Protocol):
    """One world, in which time can be set back."""

    captions: Captions

    def begin(self, seed: int, mission: str) -> Observation:
        """
        Begin an episode.

        :param seed: of the world
        :param mission: of a person's own; "" for the world's
        :return: what the agent sees
        :raises ValueError: if there can be no such mission
        """

    def step(self, action: int) -> tuple[Observation, Outcome]:
        """:return: what the agent sees after an action, and how the episode ended, if it did"""

    def state(self) -> Any:
        """:return: of the world, from which it can be restored"""

    def restore(self, state: Any) -> None:
        """
        :param state: to go back to
        """

    def world(self) -> np.ndarray:
        """:return: picture of the world, (height, width, 3) uint8"""

    def view(self, observation: Observation) -> np.ndarray:
        """:return: picture of what the agent sees, (height, width, 3) uint8"""

    def mission(self, observation: Observation) -> str:
        """:return: in words"""

    def status(self, state: Any, observation: Observation, time: int) -> str:
        """:return: how far the episode is, in words"""


def scene_of(env_id: str, seen: spaces.Dict) -> Scene:
    """
    :param env_id: name of a level of ours, or id of another environment
    :param seen: what the agent observes
    """
    return LevelScene(env_id, history_of(seen)) if is_level(env_id) else OtherScene(env_id, seen)


class LevelScene:
    """
    A level of ours.

    :param level: its name
    :param history: images before the present one that are observed
    """

    captions = Captions(
        "The world as you see it. Lighter: what the agent sees.", "All that the agent sees. It stands below, looking up."
    )

    def __init__(self, level: str, history: int) -> None:
        self.env = GuideGridEnv(level, history, render_mode="rgb_array")

    def begin(self, seed: int, mission: str) -> Observation:
        observation, _ = self.env.reset(seed=seed)
        if not mission:
            return observation
        mission = " ".join(mission.lower().split())
        self.env.set_state(with_mission(self.env.get_state(), self.env.level, mission))
        return {**observation, "mission": encode(mission)}

    def step(self, action: int) -> tuple[Observation, Outcome]:
        observation, _, fulfilled, over, _ = self.env.step(np.int64(action))
        return observation, "fulfilled" if fulfilled else "out of time" if over else ""

    def state(self) -> dict[str, np.ndarray]:
        return self.env.get_state()

    def restore(self, state: dict[str, np.ndarray]) -> None:
        self.env.set_state(state)

    def world(self) -> np.ndarray:
        return self.env.render()

    def view(self, observation: Observation) -> np.ndarray:
        return draw_view(observation["image"])

    def mission(self, observation: Observation) -> str:
        return decode(observation["mission"])

    def status(self, state: dict[str, np.ndarray], observation: Observation, time: int) -> str:
        kind, colour, _ = observation["image"][VIEW // 2, VIEW - 1]
        carrying = f", carrying the {COLOURS[colour]} {THINGS[kind]}" if kind in THINGS else ""
        status = f"Step {time} of at most {int(state['max_steps'][0])}{carrying}"
        return status if has_targets(state) else f"{status}. {LOST}"


class OtherScene:
    """
    An environment that is not ours. Its state is the seed and all that was done since: it is restored by doing that again.

    :param env_id: of an environment that Gymnasium knows
    :param seen: what the agent observes of it
    """

    def __init__(self, env_id: str, seen: spaces.Dict) -> None:
        colours = "" if picture_of(seen).values is None else ", in false colours"
        self.captions = Captions("The world as you see it.", f"All that the agent sees{colours}.")
        self._env = drawn(env_id) or gymnasium.make(env_id)
        self._seen = seen
        self._seed, self._gained = 0, 0.0
        self._actions: tuple[int, ...] = ()
        self._latest: Observation = {}

    def begin(self, seed: int, mission: str) -> Observation:
        if mission:
            raise ValueError(f"the mission {mission[:40]!r}: expected none, as only levels of ours take one of your own")
        self._seed, self._actions, self._gained = seed, (), 0.0
        return self._observed(self._env.reset(seed=seed)[0])

    def step(self, action: int) -> tuple[Observation, Outcome]:
        observation, reward, terminated, truncated, info = self._env.step(np.int64(action))
        self._actions = (*self._actions, action)
        self._gained += float(reward)
        succeeded = info.get("is_success", self._gained > 0)
        outcome: Outcome = "fulfilled" if succeeded else "failed" if terminated else "out of time"
        return self._observed(observation), outcome if terminated or truncated else ""

    def state(self) -> tuple[int, tuple[int, ...]]:
        return self._seed, self._actions

    def restore(self, state: tuple[int, tuple[int, ...]]) -> None:
        seed, actions = state
        done = len(self._actions)
        if not self._latest or seed != self._seed or self._actions != actions[:done]:
            self.begin(seed, "")
            done = 0
        for action in actions[done:]:
            self.step(action)

    def world(self) -> np.ndarray:
        picture = self._env.render() if self._env.render_mode == "rgb_array" else self.view(self._latest)
        return np.asarray(picture)

    def view(self, observation: Observation) -> np.ndarray:
        return draw_image(observation["image"], self._seen)

    def mission(self, observation: Observation) -> str:
        written = getattr(self._env.unwrapped, "mission", None)
        if isinstance(written, str):
            return written
        tokens = observation.get("mission")
        return "no mission" if tokens is None else "mission " + " ".join(str(token) for token in tokens.tolist() if token)

    def status(self, state: tuple[int, tuple[int, ...]], observation: Observation, time: int) -> str:
        return f"Step {time}"

    def _observed(self, observation: Observation) -> Observation:
        self._latest = {name: np.array(observation[name]) for name in self._seen.spaces}
        return self._latest
