"""The command: serve the playground, or write a page of recorded episodes."""

import os
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import torch as th

from sb3_guide.cloning import mission_seeds
from sb3_guide.files import write_text
from sb3_guide.playground.cast import Cast
from sb3_guide.playground.episode import Beginning
from sb3_guide.playground.session import Session

MOST_EPISODES = 20  # of each agent on a page, which holds all their pictures


def play(folders: Sequence[Path], level: str | None, host: str, port: int) -> None:
    """
    Serve the playground until it is interrupted.

    :param folders: of agents to choose from, besides those that are shipped
    :param level: where to begin, and where agents play that don't say where they were trained
    :param host: address to listen at
    :param port: to listen at
    :raises RuntimeError: if a package is missing
    :raises ValueError: if one cannot listen there, or an agent has no channel
    """
    with needing_the_extra():
        from sb3_guide.playground.page import serve
    check_free(host, port)
    cast = prepared(folders, level)
    Session.restored(cast, cast.first).step()  # all that takes time at first takes it before the page is asked for
    print(f"The playground is at http://{host}:{port} until you press Ctrl+C.", flush=True)
    serve(cast, host, port)


def export(folders: Sequence[Path], level: str | None, episodes: int, path: Path) -> None:
    """
    Write a page that shows episodes of each agent, on missions of the analysis split.

    :param folders: of agents; the shipped guided Learners, if there are none
    :param level: to play; None takes the one where each agent was trained
    :param episodes: of each agent
    :param path: of the page; its folder is made
    :raises RuntimeError: if a package is missing
    :raises ValueError: if an agent has no channel, or there are too few episodes or too many
    """
    with needing_the_extra():
        from sb3_guide.playground.export import html_of, recorded
    if not 1 <= episodes <= MOST_EPISODES:
        raise ValueError(f"{episodes} episodes of each agent were asked for: expected 1 to {MOST_EPISODES}")
    if path.is_dir():
        raise ValueError(f"{path} is a folder: expected a file to write, such as {path / 'episodes.html'}")
    cast = prepared(folders, level)
    names = [name for name, folder in cast.folders.items() if folder in folders or (not folders and folder.name == "guided")]
    scenes = []
    for name in names:
        for seed in mission_seeds("analysis", episodes).tolist():
            session = Session(cast, [name], Beginning(level or cast.level(name), seed))
            while not session.ended:
                session.step()
            scenes.append([recorded(seat) for seat in session.seats])
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, html_of(scenes))
    print(f"{path} shows {len(scenes)} episodes; open it in a browser.")


def prepared(folders: Sequence[Path], level: str | None) -> Cast:
    """:return: the agents, of networks so small that more than one thread would wait for each other"""
    th.set_num_threads(1)
    return Cast(folders, level)


@contextmanager
def needing_the_extra() -> Iterator[None]:
    """
    Import what a core installation lacks.

    :raises RuntimeError: if it is missing
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise RuntimeError(f"the playground needs {error.name}: pip install 'sb3-guide[playground]'") from error


def check_free(host: str, port: int) -> None:
    """
    :raises ValueError: if one cannot listen there
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as listener:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)
        raise ValueError(
            f"can't listen at {host}:{port} ({reason}): expected a free port of this machine, such as --port {port + 1}"
        ) from error
