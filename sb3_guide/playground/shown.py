"""What a page shows of an agent at a moment, in words and numbers: the same where it is served and where it is exported."""

from typing import NamedTuple

import numpy as np

from sb3_guide.envs import ACTIONS, decode
from sb3_guide.envs.engine.cells import BALL, BOX, COLOURS, KEY, VIEW
from sb3_guide.envs.given_mission import has_targets
from sb3_guide.language import Dictionary
from sb3_guide.playground.episode import Episode, Moment, Turn

THINGS = {KEY: "key", BALL: "ball", BOX: "box"}
ONE_ROOM = 8  # cells
GUIDE, AGENT, YOU = "guide", "agent", "you"  # who says or does it, which is a colour


class Part(NamedTuple):
    """
    Of a sentence.

    :param text: of it
    :param who: GUIDE, AGENT, YOU or "" for nobody
    """

    text: str
    who: str = ""


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
    names, likeliest = speaker.shape.names(), moment.action_probabilities.argmax(axis=1)
    lines = [
        Line(
            name,
            meaning(speaker.dictionary, message),
            round(float(moment.message_probabilities[message]), 4),
            ACTIONS[likeliest[message]],
            round(float(moment.action_probabilities[message, likeliest[message]]), 4),
            chances(moment.action_probabilities[message]),
            message == moment.spoken,
            by_person and message == heard,
            bool(likeliest[message] != likeliest[moment.spoken]),
        )
        for message, name in enumerate(names)
    ]
    mission, limit = decode(moment.observation["mission"]), int(moment.world["max_steps"][0])
    carried = carries(moment)
    status = f"Step {time} of at most {limit}" + (f", carrying the {carried}" if carried else "")
    if not has_targets(moment.world):
        status += ". Something that the mission speaks of is not there, so that it can't be fulfilled."
    return Shown(mission, status, moment.outcome, speech(moment, lines, heard, by_person, time), lines)


def speech(moment: Moment, lines: list[Line], heard: int, by_person: bool, time: int) -> list[Part]:
    """:return: a sentence or two about the moment"""
    if moment.outcome:
        how = Part("Mission fulfilled", GUIDE) if moment.outcome == "fulfilled" else Part("Out of time", YOU)
        return [how, Part(f" after {time} step{'' if time == 1 else 's'}.")]
    spoken, told = lines[moment.spoken], lines[heard]
    parts = [Part("The Guide says "), Part(spoken.message, GUIDE), Part(f" ({percent(spoken.says)})")]
    if by_person:
        parts += [Part(", but you say "), Part(told.message, YOU)]
    action = Part(told.action, YOU if told.differs else AGENT)
    return [*parts, Part("; hearing it, the agent chooses "), action, Part(f" ({percent(told.does)}).")]


def turn_in_words(episode: Episode, turn: Turn) -> str:
    """:return: such as "w0 w2: left" """
    return f"{episode.speaker.shape.names()[turn.heard]}: {ACTIONS[turn.action]}"


def meaning(dictionary: Dictionary, message: int) -> str:
    """:return: what a message means, in words"""
    action = dictionary.meanings[message]
    if action >= 0:
        return ACTIONS[action]
    counts = dictionary.counts[message]
    return f"mostly {ACTIONS[counts.argmax()]}" if counts.sum() else "never said"


def chances(probabilities: np.ndarray) -> str:
    """:return: such as "left 98 %, forward 2 %", without what is less likely than one in two hundred"""
    order = [action for action in np.argsort(-probabilities, kind="stable") if probabilities[action] >= 0.005]
    return ", ".join(f"{ACTIONS[action]} {percent(float(probabilities[action]))}" for action in order)


def percent(share: float) -> str:
    """:return: such as "98 %", which no line break tears apart"""
    return ("<1%" if 0 < share < 0.005 else f"{share:.0%}").replace("%", "\N{NO-BREAK SPACE}%")


def pictures_class(cells: int) -> str:
    """
    :param cells: that the world is wide
    :return: how its picture and that of the view are laid out: mazes need more room than the view
    """
    return "pictures" if cells <= ONE_ROOM else "pictures large"


def carries(moment: Moment) -> str:
    """:return: such as "red ball", "" if the agent carries nothing"""
    kind, colour, _ = moment.observation["image"][VIEW // 2, VIEW - 1]
    return f"{COLOURS[colour]} {THINGS[kind]}" if kind in THINGS else ""
