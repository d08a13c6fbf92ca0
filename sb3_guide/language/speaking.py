"""A person, or a program, in the Guide's place (paper section 5.4)."""

import re
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_guide.cloning.episodes import check_sees, worlds_at_once
from sb3_guide.envs import worlds_of
from sb3_guide.language.dictionary import Dictionary
from sb3_guide.policies import AgentPolicy
from sb3_guide.policies.channel import MessageShape
from sb3_guide.policies.interventions import Chosen
from sb3_guide.policies.sequences import history_of

Message = str | Sequence[int] | np.ndarray
#: actions of the paper's choreographies, by name
CHOREOGRAPHIES = {"pirouette": ["right"] * 4, "waltz": ["forward", "forward", "right"] * 4}
STEPS = 10  # messages that each world is told in a row, of those that measure obedience


def speak(
    model: BaseAlgorithm | AgentPolicy,
    obs: dict[str, np.ndarray],
    message: Message,
    state: tuple[np.ndarray, ...] | None = None,
    episode_start: np.ndarray | None = None,
    deterministic: bool = True,
) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
    """
    SB3's ``predict`` for an agent that hears this message instead of its Guide's.

    :param model: whose policy has a channel, or the policy itself
    :param obs: of one world or of B of them, as ``predict`` takes it
    :param message: such as "w0 w2" or (0, 2); or (B, length), one for each world
    :param state: as in ``predict``
    :param episode_start: as in ``predict``
    :param deterministic: take the most probable action
    :return: actions and the next state, as ``predict`` returns them
    :raises ValueError: if the agent has no channel, or there is no such message
    """
    policy = model.policy if isinstance(model, BaseAlgorithm) else model
    if not isinstance(policy, AgentPolicy):
        raise ValueError(f"{type(policy).__name__} hears no messages: expected a GuidePolicy or a GuidedLearnerPolicy")
    with policy.hearing(Chosen(symbols_of(message, policy.channel.encoder.shape))):
        return policy.predict(obs, state, episode_start, deterministic)


def symbols_of(message: Message, shape: MessageShape) -> Sequence[int] | np.ndarray:
    """
    :param message: such as "w0 w2", or its symbols
    :param shape: of the agent's messages
    :return: its symbols
    :raises ValueError: if a text is no message of this shape
    """
    if not isinstance(message, str):
        return message
    symbols = [int(word[1:]) if re.fullmatch(r"w\d{1,9}", word) else -1 for word in message.split()]
    if len(symbols) != shape.length or not all(0 <= symbol < shape.vocabulary_size for symbol in symbols):
        example = " ".join(f"w{position % shape.vocabulary_size}" for position in range(shape.length))
        raise ValueError(
            f"{message!r} is no message of this agent: expected {shape.length} words from w0 to "
            f"w{shape.vocabulary_size - 1}, such as {example!r}"
        )
    return symbols


def steps_of(choreography: str, dictionary: Dictionary) -> list[int]:
    """
    :param choreography: actions or messages, separated by commas or on lines of their own, such as "forward, w0 w2"; what
        follows a # is a comment
    :param dictionary: of the agent that is to perform it
    :return: index of the message for each step
    :raises ValueError: if it is empty, or a step is neither an action that the agent has a word for nor a message
    """
    lines = [line.partition("#")[0] for line in choreography.splitlines()]
    steps = [step.strip() for line in lines for step in line.split(",") if step.strip()]
    if not steps:
        raise ValueError("the choreography is empty: expected actions or messages, such as 'forward, forward, right'")
    return [message_of(step, dictionary) for step in steps]


def danced(name: str, dictionary: Dictionary) -> str:
    """
    :param name: of one of CHOREOGRAPHIES
    :param dictionary: of the agent that is to perform it
    :return: its steps, which turn to the left where that is the only side that the agent has a word for
    """
    known = [dictionary.actions[action] for action in dictionary.meanings if action >= 0]
    left, right = (side in known for side in ("left", "right"))
    return ", ".join("left" if step == "right" and left and not right else step for step in CHOREOGRAPHIES[name])


def message_of(step: str, dictionary: Dictionary) -> int:
    """
    :param step: name of an action, or a message
    :return: index of the message
    :raises ValueError: if it is neither
    """
    if step in dictionary.actions:
        return dictionary.message_for(dictionary.actions.index(step))
    names = dictionary.shape.names()
    if " ".join(step.split()) not in names:
        known, shape = ", ".join(dictionary.actions), dictionary.shape
        raise ValueError(
            f"step {step!r} is unknown: expected one of {known}, or a message of {shape.length} words from w0 to "
            f"w{shape.vocabulary_size - 1}, such as {names[1]!r}"
        )
    return names.index(" ".join(step.split()))


@dataclass(frozen=True)
class Performance:
    """
    What B worlds did when they were told T messages one after the other; a new mission begins where one ends.

    :param told: (T, B) int64 index of the message
    :param taken: (T, B) int64 action
    """

    told: np.ndarray
    taken: np.ndarray


def perform(policy: AgentPolicy, level: str, seeds: np.ndarray, told: np.ndarray) -> Performance:
    """
    Tell an agent one message after the other, and watch what it does.

    :param policy: with a channel
    :param level: name or id of the level, or id of another environment
    :param seeds: (B,) of the missions
    :param told: (T, B) index of the message at each step in each world
    :raises ValueError: if the agent has no channel, or is of another level
    """
    symbols = policy.channel.encoder.shape.all().numpy()[told]  # (T, B, length)
    at_once, taken = worlds_at_once(level, len(seeds)), np.zeros_like(told)
    with closing(worlds_of(level, at_once, history_of(policy.observation_space), go_on=True)) as worlds:
        names = check_sees(policy, worlds.observation_space, level)
        for start in range(0, len(seeds), at_once):
            chunk = np.resize(np.arange(start, min(start + at_once, len(seeds))), at_once)  # the last one is filled up
            obs: Any = worlds.reset_to(seeds[chunk])
            state, starts = None, np.ones(at_once, dtype=bool)
            for step, message in enumerate(symbols[:, chunk]):
                seen = {name: obs[name] for name in names}
                taken[step, chunk], state = speak(policy, seen, message, state, starts)
                obs, _, starts, _ = worlds.step(taken[step, chunk])
    return Performance(told, taken)


def obey(
    policy: AgentPolicy, level: str, dictionary: Dictionary, seeds: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """
    Tell an agent random messages that mean something, ten in a row on each mission (paper section 5.4).

    :param policy: with a channel
    :param level: name or id of the level, or id of another environment
    :param dictionary: learned on other missions
    :param seeds: (B,) of the missions
    :param rng: that draws the messages, each that means something being equally probable
    :return: the action that each message means and the one that was taken, (10 * B,) int64 each
    :raises ValueError: if no message means anything
    """
    meanings = dictionary.meanings
    meaningful = np.flatnonzero(meanings >= 0)
    if not len(meaningful):
        raise ValueError("no message of this agent means anything: each was seen too seldom, or no action follows it strongly")
    told = rng.choice(meaningful, size=(STEPS, len(seeds)))
    return meanings[told].ravel(), perform(policy, level, seeds, told).taken.ravel()
