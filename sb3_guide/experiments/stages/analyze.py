"""What the messages of an agent go together with, and what they cause (paper section 5)."""

import time
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sb3_guide.cloning import load_demonstrations, mission_seeds
from sb3_guide.envs import is_level, level_of
from sb3_guide.experiments.stages.levels import level_of_agent
from sb3_guide.experiments.stages.runs import check_result, record, use_threads
from sb3_guide.files import write_json
from sb3_guide.language import Reading, read, read_along
from sb3_guide.language.analysis import change, communication, in_situations, influences, structure, tables
from sb3_guide.language.animation import replay, worth_watching, write_animation
from sb3_guide.language.pictures import change_bars, conditional_bars, save_figure, view_maps
from sb3_guide.policies import load_agent

OPTIONAL = ("situations.png", "cells.png", "change.png", "episode.gif")  # so that none of an earlier analysis is left


def analyze(
    agent: Path, level: str | None, demos: Path | None, guide: Path | None, out: Path, threads: int, n_episodes: int
) -> None:
    """
    :param agent: folder of an agent with a channel
    :param level: see :func:`~sb3_guide.experiments.stages.levels.level_of_agent`
    :param demos: file of demonstrations that no agent was trained on, along which CIC is measured as well, as in the paper
    :param guide: folder of the Guide that the agent has learned from, to tell what became of its words
    :param out: folder for analysis.json, its figures and episode.gif
    :param threads: of torch
    :param n_episodes: missions to play, from the analysis split
    :raises ValueError: if an agent has no channel or is of another level, the demonstrations are or are damaged, or the folder
        holds another analysis.json
    """
    result = out / "analysis.json"
    check_result(result, "analyze")
    level = level_of_agent(agent, level)
    use_threads(threads)
    started = time.monotonic()
    policy, seeds = load_agent(agent), mission_seeds("analysis", n_episodes)
    demonstrations = None if demos is None else load_demonstrations(demos, level)
    before = None if guide is None else read(load_agent(guide), level_of_agent(guide, level), seeds)
    reading = read(policy, level, seeds)
    found: dict[str, Any] = {
        "agent": type(policy).__name__,
        "messages": reading.shape.names(),
        "actions": list(reading.actions),
        "episodes": len(reading.episodes),
        "frames": len(reading.messages),
        **tables(reading),
        **({**in_situations(reading), **structure(reading)} if is_level(level) and level_of(level).sentences == 1 else {}),
        "in_play": communication(reading),
        "episode": step_by_step(reading, worth_watching(reading)),
    }
    if demonstrations is not None:
        found["along_demonstrations"] = communication(read_along(policy, level, demonstrations.episodes))
    if before is not None:
        found |= change(before, reading)
    out.mkdir(parents=True, exist_ok=True)
    if result.exists():
        for name in OPTIONAL:
            (out / name).unlink(missing_ok=True)
    draw(found, out)
    if (shown := replay(reading, level, worth_watching(reading))) is not None:
        write_animation(out / "episode.gif", *shown)
    settings = {
        "level": level,
        "folder": str(agent),
        "demos": None if demos is None else str(demos),
        "guide": None if guide is None else str(guide),
        "threads": threads,
    }
    write_json(result, {**record("analyze", settings, time.monotonic() - started), **found})


def step_by_step(reading: Reading, episode: int) -> dict[str, Any]:
    """:return: what was said and done at each step of an episode, and how far the message moved the agent, in nats"""
    first, last = reading.episodes.offsets[episode : episode + 2]
    moved, names = influences(reading), reading.shape.names()
    return {
        "mission_seed": int(reading.episodes.seeds[episode]),
        "messages": [names[message] for message in reading.messages[first:last]],
        "actions": [reading.actions[action] for action in reading.episodes.actions[first:last]],
        **{name: moved[name][first:last].tolist() for name in ("influence", "influence_among_all")},
    }


def draw(found: dict[str, Any], out: Path) -> None:
    """
    :param found: content of analysis.json
    :param out: folder of the figures
    """

    def bars(rows: list[str], columns: list[str], counts: list[Any], bounds: list[Any]) -> Figure:
        return conditional_bars(rows, columns, np.array(counts), np.array(bounds, dtype=np.float64))

    messages = found["messages"]
    save_figure(bars(messages, found["actions"], found["counts"], found["action_intervals"]), out / "actions.png")
    if "situations" in found:
        rows = [f"target {name}" for name in found["situations"]]
        figure = bars(rows, messages, found["situation_counts"], found["situation_intervals"])
        save_figure(figure, out / "situations.png")
        save_figure(view_maps(messages, np.array(found["cell_counts"])), out / "cells.png")
    if "change" in found:
        before, after = np.array(found["counts_before"]), np.array(found["counts"])
        bounds = np.array(found["change_intervals"], dtype=np.float64)
        save_figure(change_bars(messages, found["actions"], before, after, bounds), out / "change.png")
