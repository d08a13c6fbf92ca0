"""The agents that can be watched: a list that is fixed when the playground starts."""

from collections.abc import Sequence
from pathlib import Path
from threading import Lock
from typing import cast

import numpy as np
from gymnasium import spaces

from sb3_guide.cloning import mission_seeds
from sb3_guide.envs import LEVELS, is_level, name_of
from sb3_guide.language import overhear, speak
from sb3_guide.policies import load_agent
from sb3_guide.policies.folder import AGENT, read_agent
from sb3_guide.policies.networks import Guide
from sb3_guide.speakers import FOLDER as SHIPPED

LEARNED_ON = 200  # missions of the validation split, which take about a second
GUIDE, LEARNER = "a Guide, which acts on its own messages", "a Learner, which hears its Guide"
BEGINNING = ("GoToLocal/guided", "3")  # agent and world, if nobody asks for others


class Speaker:
    """
    An agent with a channel, and what its messages mean on the level where it was trained.

    :param folder: of the agent
    :param level: name of that level, or id of another environment
    :raises FileNotFoundError: if there is no agent in the folder
    :raises ValueError: if the agent has no channel, or one of too many messages
    """

    def __init__(self, folder: Path, level: str) -> None:
        self.policy = load_agent(folder)
        self.seen = cast(spaces.Dict, self.policy.observation_space)
        self.shape = self.policy.channel.encoder.shape
        self.symbols = self.shape.all().numpy()  # (M, length)
        self.level = level
        self.kind = f"{GUIDE if isinstance(self.policy.network, Guide) else LEARNER}, trained on {level}"
        self.dictionary = overhear(self.policy, level, mission_seeds("validation", LEARNED_ON))
        self._one_at_a_time = Lock()  # what the policy hears is part of its state, and sessions share it

    def check_level(self, level: str) -> None:
        """
        :param level: name of a level, or id of another environment
        :raises ValueError: if the agent can't play there
        """
        if level not in levels_of(self.level):
            expected = f"{self.level}, or another level of ours" if is_level(self.level) else self.level
            raise ValueError(f"an agent trained on {self.level} can't play {level}: expected {expected}")

    def check(self, messages: Sequence[int]) -> None:
        """
        :param messages: indices
        :raises ValueError: if there is no such message
        """
        wrong = [message for message in messages if not 0 <= message < self.shape.count]
        if wrong:
            raise ValueError(f"message {wrong[0]} of this agent: expected 0 to {self.shape.count - 1}")

    def tell(
        self, observation: dict[str, np.ndarray], memory: tuple[np.ndarray, ...] | None, message: int
    ) -> tuple[int, tuple[np.ndarray, ...] | None]:
        """
        :param observation: of one world
        :param memory: of the time before, as ``predict`` returns it
        :param message: index of the message that is heard
        :return: the most probable action, and the memory after it
        """
        with self._one_at_a_time:
            action, memory = speak(self.policy, observation, self.symbols[message], memory)
        return int(action), memory


class Cast:
    """
    Agents by name; each is loaded when it first plays.

    :param folders: of agents to choose from, besides those that are shipped
    :param level: where the agents in these folders play if they don't say where they were trained
    :raises FileNotFoundError: if there is no agent in a folder
    :raises ValueError: if an agent has no channel, or there is no level for it
    """

    def __init__(self, folders: Sequence[Path] = (), level: str | None = None) -> None:
        possible = [SHIPPED / of / agent for of in LEVELS for agent in ("guided", "guide")]
        shipped = [folder for folder in possible if (folder / AGENT).is_file()]
        named = {str(folder): folder for folder in folders if folder not in shipped}
        self.folders = {**named, **{str(folder.relative_to(SHIPPED)): folder for folder in shipped}}
        self._levels = {name: home_of(folder, level) for name, folder in self.folders.items()}
        self.first = self._first(list(named), None if level is None else name_of(level))
        self._speakers: dict[str, Speaker] = {}
        for name in named:
            self.speaker(name)

    def _first(self, named: list[str], level: str | None) -> dict[str, str]:
        """:return: what a link to the beginning holds"""
        agent, seed = BEGINNING
        agent = named[0] if named else f"{level}/guided" if f"{level}/guided" in self.folders else agent
        return {"agent": agent, "level": level or self.level(agent), "seed": seed}

    def level(self, name: str) -> str:
        """
        :param name: of an agent
        :return: name of the level where it was trained
        :raises ValueError: if there is no such agent
        """
        if name not in self._levels:
            raise ValueError(f"there is no agent {name!r}: expected one of {', '.join(self.folders)}")
        return self._levels[name]

    def speaker(self, name: str) -> Speaker:
        """
        :param name: of an agent
        :raises ValueError: if there is no such agent
        """
        level = self.level(name)
        if name not in self._speakers:
            self._speakers[name] = Speaker(self.folders[name], level)
        return self._speakers[name]


def home_of(folder: Path, level: str | None) -> str:
    """
    :param folder: of an agent
    :param level: if it does not say
    :return: name of the level where it was trained, the first one of several, or id of another environment
    :raises ValueError: if nobody says
    """
    trained = (read_agent(folder)[0].level or "").split("+")[0] or level
    if trained is None:
        raise ValueError(f"{folder} does not say where it was trained: expected --level, such as --level GoToLocal")
    return name_of(trained)


def levels_of(home: str) -> list[str]:
    """
    :param home: where an agent was trained
    :return: where it can play: on all levels of ours, or in that other environment alone
    """
    return list(LEVELS) if is_level(home) else [home]
