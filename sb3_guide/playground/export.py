"""Episodes as a page of its own, which needs neither server nor network, and as a GIF."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from sb3_guide.language.animation import Caption, animation
from sb3_guide.playground.episode import Turn
from sb3_guide.playground.pictures import data_url
from sb3_guide.playground.scenes import Captions
from sb3_guide.playground.session import Seat
from sb3_guide.playground.shown import Shown, pictures_class, shown, turn_in_words


class Recording(NamedTuple):
    """
    What an agent did so far: T turns.

    :param agent: its name
    :param kind: what it is, in words
    :param moments: what is shown at each of the T + 1 moments
    :param turns: T of them
    :param turns_in_words: the same
    :param messages: names of all messages
    :param worlds: T + 1 pictures of the world
    :param views: T + 1 pictures of what the agent saw
    :param captions: of these pictures
    :param actions: names of all actions
    """

    agent: str
    kind: str
    moments: list[Shown]
    turns: list[Turn]
    turns_in_words: list[str]
    messages: list[str]
    worlds: Sequence[np.ndarray]
    views: list[np.ndarray]
    captions: Captions
    actions: tuple[str, ...]


def recorded(seat: Seat) -> Recording:
    """
    :param seat: of the agent
    :return: all that happened up to the present moment, with what the agent hears there
    """
    episode = seat.episode
    present = Turn(seat.heard, seat.told is not None, -1)
    turns = [*episode.turns, present]
    return Recording(
        seat.name,
        episode.speaker.kind,
        [shown(episode, time, turn.heard, turn.by_person) for time, turn in enumerate(turns)],
        list(episode.turns),
        [turn_in_words(episode, turn) for turn in episode.turns],
        episode.speaker.shape.names(),
        episode.pictures(),
        [episode.scene.view(moment.observation) for moment in episode.moments],
        episode.scene.captions,
        episode.speaker.dictionary.actions,
    )


def html_of(scenes: Sequence[Sequence[Recording]]) -> str:
    """
    :param scenes: each of one recording or of two that are watched side by side
    :return: a page that holds all of it, pictures included
    """
    environment = Environment(
        loader=PackageLoader("sb3_guide.playground"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("episodes.html.j2").render(data=data_of(scenes))


def data_of(scenes: Sequence[Sequence[Recording]]) -> dict[str, Any]:
    """
    :param scenes: as :func:`html_of` takes them
    :return: the same as JSON, each picture once
    """
    pictures: dict[str, int] = {}
    told = [[seat_data(recording, pictures) for recording in scene] for scene in scenes]
    return {"scenes": told, "pictures": list(pictures)}


def seat_data(recording: Recording, pictures: dict[str, int]) -> dict[str, Any]:
    """
    :param recording: of one agent
    :param pictures: number of each picture, which are added to
    """
    moments = []
    for moment, world, view in zip(recording.moments, recording.worlds, recording.views, strict=True):
        drawn = (data_url(world), data_url(view))
        world_number, view_number = (pictures.setdefault(picture, len(pictures)) for picture in drawn)
        lines = [line._asdict() for line in moment.lines]
        speech = [part._asdict() for part in moment.speech]
        moments.append({**moment._asdict(), "lines": lines, "speech": speech, "world": world_number, "view": view_number})
    turns = [
        {"text": text, "by_person": turn.by_person}
        for text, turn in zip(recording.turns_in_words, recording.turns, strict=True)
    ]
    return {
        "agent": recording.agent,
        "kind": recording.kind,
        "layout": pictures_class(recording.worlds[0]),
        "captions": recording.captions._asdict(),
        "moments": moments,
        "turns": turns,
    }


def gif_of(recording: Recording) -> bytes:
    """:return: a GIF of what happened"""
    captions = []
    for moment, turn in zip(recording.moments, recording.turns, strict=False):
        heard = recording.messages[turn.heard] + (" (you)" if turn.by_person else "")
        captions.append(Caption(moment.mission, heard, recording.actions[turn.action]))
    captions.append(Caption(recording.moments[-1].mission, "", ""))
    return animation(recording.worlds, captions)
