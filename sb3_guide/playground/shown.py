"""What a page shows of an agent at a moment, in words and numbers: the same where it is served and where it is exported."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sb3_guide.envs.rendering import TILE
from sb3_guide.language import Dictionary
from sb3_guide.playground.episode import Episode, Moment, Turn

ONE_ROOM = 8 * TILE  # pixels
GUIDE, AGENT, YOU = "guide", "agent", "you"  # who says or does it, which is a colour


class Part(NamedTuple):
    """
    Of a sentence.

    :param text: of it
    :param who: GUIDE, AGENT, YOU or "" for nobody
    """

    text: str
    who: str = ""


ENDINGS = {
    "fulfilled": Part("Mission fulfilled", GUIDE),
    "out of time": Part("Out of time", YOU),
    "failed": Part("Failed", YOU),
}


class Line(NamedTuple):
    """
    What a page shows of one message.

    :param message: such as "w0 w2"
    :param meaning: in the agent's dictionary
    :param says: probability that the Guide says it
    :param action: the most probable one, if it is heard
    :param does: its probability
    :param chances: of all actions, in words
    :param spoken: whether the Guide says it
    :param told: whether a person says it in the Guide's place
    :param differs: whether the agent would act otherwise than on the Guide's message
    """

    message: str
    meaning: str
    says: float
    action: str
    does: float
    chances: str
    spoken: bool
    told: bool
    differs: bool


class Shown(NamedTuple):
    """
    :param mission: as the agent hears it
    :param status: how far the episode is
    :param outcome: how it ended, "" before that
    :param speech: what is said and what comes of it
    :param lines: for each message
    """

    mission: str
    status: str
    outcome: str
    speech: list[Part]
    lines: list[Line]


def shown(episode: Episode, time: int, heard: int, by_person: bool) -> Shown:
    """
    :param episode: of an agent
    :param time: which of its moments
    :param heard: index of the message that the agent hears at that moment
    :param by_person: whether a person says it
    """
    moment, speaker = episode.moments[time], episode.speaker
    names, actions, likeliest = speaker.shape.names(), speaker.dictionary.actions, moment.action_probabilities.argmax(axis=1)
    lines = [
        Line(
            name,
            meaning(speaker.dictionary, message),
            round(float(moment.message_probabilities[message]), 4),
            actions[likeliest[message]],
            round(float(moment.action_probabilities[message, likeliest[message]]), 4),
            chances(moment.action_probabilities[message], actions),
            message == moment.spoken,
            by_person and message == heard,
            bool(likeliest[message] != likeliest[moment.spoken]),
        )
        for message, name in enumerate(names)
    ]
    mission = episode.scene.mission(moment.observation)
    status = episode.scene.status(moment.world, moment.observation, time)
    return Shown(mission, status, moment.outcome, speech(moment, lines, heard, by_person, time), lines)


def speech(moment: Moment, lines: list[Line], heard: int, by_person: bool, time: int) -> list[Part]:
    """:return: a sentence or two about the moment"""
    if moment.outcome:
        return [ENDINGS[moment.outcome], Part(f" after {time} step{'' if time == 1 else 's'}.")]
    spoken, told = lines[moment.spoken], lines[heard]
    parts = [Part("The Guide says "), Part(spoken.message, GUIDE), Part(f" ({percent(spoken.says)})")]
    if by_person:
        parts += [Part(", but you say "), Part(told.message, YOU)]
    action = Part(told.action, YOU if told.differs else AGENT)
    return [*parts, Part("; hearing it, the agent chooses "), action, Part(f" ({percent(told.does)}).")]


def turn_in_words(episode: Episode, turn: Turn) -> str:
    """:return: such as "w0 w2: left" """
    speaker = episode.speaker
    return f"{speaker.shape.names()[turn.heard]}: {speaker.dictionary.actions[turn.action]}"


def meaning(dictionary: Dictionary, message: int) -> str:
    """:return: what a message means, in words"""
    action = dictionary.meanings[message]
    if action >= 0:
        return dictionary.actions[action]
    counts = dictionary.counts[message]
    return f"mostly {dictionary.actions[counts.argmax()]}" if counts.sum() else "never said"


def chances(probabilities: np.ndarray, actions: Sequence[str]) -> str:
    """:return: such as "left 98 %, forward 2 %", without what is less likely than one in two hundred"""
    order = [action for action in np.argsort(-probabilities, kind="stable") if probabilities[action] >= 0.005]
    return ", ".join(f"{actions[action]} {percent(float(probabilities[action]))}" for action in order)


def percent(share: float) -> str:
    """:return: such as "98 %", which no line break tears apart"""
    return ("<1%" if 0 < share < 0.005 else f"{share:.0%}").replace("%", "\N{NO-BREAK SPACE}%")


def pictures_class(world: np.ndarray) -> str:
    """
    :param world: picture of it, (height, width, 3)
    :return: how it and the picture of the view are laid out: mazes need more room than the view
    """
    return "pictures" if world.shape[1] <= ONE_ROOM else "pictures large"
