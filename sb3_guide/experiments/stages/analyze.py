"""What the messages of an agent go together with, and what they cause (paper section 5)."""

import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch as th
from matplotlib.figure import Figure

from sb3_guide.cloning import load_demonstrations, measure_communication, mission_seeds
from sb3_guide.envs import GuideGridEnv, is_level
from sb3_guide.experiments.stages.animation import Caption, write_animation
from sb3_guide.experiments.stages.levels import environment
from sb3_guide.experiments.stages.runs import record, use_threads
from sb3_guide.files import write_json
from sb3_guide.language import SITUATIONS, Reading, memory_of, read, situations, targets
from sb3_guide.language.pictures import conditional_bars, save_figure, view_maps
from sb3_guide.metrics import (
    cic,
    cic_as_published,
    episode_sums,
    influence,
    joint_counts,
    message_entropy,
    positive_signalling,
    ratio_interval,
    symbol_information,
    uniform_cic,
)
from sb3_guide.policies import load_agent

SHOWN_LENGTH = 8  # frames that an episode needs to be worth watching


def analyze(agent: Path, level: str, demos: Path | None, out: Path, threads: int, n_episodes: int = 500) -> None:
    """
    :param agent: folder of an agent with a channel
    :param level: see :func:`~sb3_guide.experiments.stages.levels.environment`
    :param demos: file of demonstrations that no agent was trained on, along which CIC is measured as well, as in the paper
    :param out: folder for analysis.json, its figures and episode.gif
    :param threads: of torch
    :param n_episodes: missions to play, from the analysis split
    :raises ValueError: if the agent has no channel, or the demonstrations are damaged
    """
    level = environment(level)
    use_threads(threads)
    started = time.monotonic()
    policy = load_agent(agent)
    reading = read(policy, level, mission_seeds("analysis", n_episodes))
    found: dict[str, Any] = {
        "agent": type(policy).__name__,
        "messages": reading.shape.names(),
        "actions": list(reading.actions),
        "episodes": len(reading.episodes),
        "frames": len(reading.messages),
        **tables(reading),
        **(in_situations(reading) if is_level(level) else {}),
        "in_play": communication(reading),
        "positive_signalling": positive_signalling(reading.message_log_probs),
    }
    if demos is not None:
        found |= measure_communication(policy, memory_of(policy, load_demonstrations(demos).episodes))
    out.mkdir(parents=True, exist_ok=True)
    draw(found, out)
    animate(reading, level, out / "episode.gif")
    settings = {"level": level, "folder": str(agent), "demos": None if demos is None else str(demos), "threads": threads}
    write_json(out / "analysis.json", {**record("analyze", settings, time.monotonic() - started), **found})


def tables(reading: Reading) -> dict[str, Any]:
    """:return: which actions follow which messages: counts, and 95 % intervals (2, M, A) of the conditional probabilities"""
    episodes, n_messages = reading.episodes, reading.shape.count
    actions = by_episode(reading.episode, reading.messages, episodes.actions, len(episodes), n_messages, len(reading.actions))
    return {
        "counts": actions.sum(axis=0).tolist(),
        "action_intervals": intervals(actions),
        "symbol_information": symbol_information(actions.sum(axis=0), reading.shape.length).tolist(),
    }


def in_situations(reading: Reading) -> dict[str, Any]:
    """:return: which messages are spoken where: counts and intervals as in :func:`tables`, with the target in each cell too"""
    episodes, messages, n_messages = reading.episodes, reading.messages, reading.shape.count
    found = targets(episodes)
    situation = situations(found)
    inside = situation >= 0
    frame, across, down = found.nonzero()
    cells = joint_counts(across * found.shape[2] + down, messages[frame], found[0].size, n_messages)
    spoken = by_episode(
        reading.episode[inside], situation[inside], messages[inside], len(episodes), len(SITUATIONS), n_messages
    )
    return {
        "situations": list(SITUATIONS),
        "situation_counts": spoken.sum(axis=0).tolist(),
        "situation_intervals": intervals(spoken),
        "cell_counts": cells.reshape(*found.shape[1:], n_messages).tolist(),
    }


def by_episode(
    episode: np.ndarray, rows: np.ndarray, columns: np.ndarray, n_episodes: int, n_rows: int, n_columns: int
) -> np.ndarray:
    """:return: (E, R, C) int64, how often each row came with each column in each episode"""
    return joint_counts(episode * n_rows + rows, columns, n_episodes * n_rows, n_columns).reshape(
        n_episodes, n_rows, n_columns
    )


def intervals(counts: np.ndarray) -> list[Any]:
    """
    :param counts: (E, R, C) of each episode
    :return: (2, R, C) bounds of P(column|row), None where a row hardly occurs
    """
    bounds = ratio_interval(counts, counts.sum(axis=2, keepdims=True), np.random.default_rng(0))
    return np.where(np.isnan(bounds), np.array(None), bounds).tolist()


def communication(reading: Reading) -> dict[str, dict[str, float]]:
    """:return: mean over the frames that were played, and its 95 % interval, of each measure of communication, in nats"""
    spoken, acted = reading.message_log_probs, reading.action_log_probs
    measures = {
        "cic": cic(spoken, acted),
        "cic_as_published": cic_as_published(spoken, acted),
        "uniform_cic": uniform_cic(acted),
        "message_entropy": message_entropy(spoken),
        "influence": influence(th.as_tensor(reading.messages), spoken, acted),
    }
    found = {}
    for name, values in measures.items():
        sums = episode_sums(values.numpy(), reading.episode)
        low, high = ratio_interval(sums, reading.episodes.lengths, np.random.default_rng(0))
        found[name] = {"mean": float(values.mean()), "low": float(low), "high": float(high)}
    return found


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


def animate(reading: Reading, level: str, path: Path) -> None:
    """
    Draw the first successful episode that is long enough to be worth watching, or the longest successful one, if the
    environment can draw itself.

    :param reading: what was played
    :param level: name of the level, or id of another environment
    :param path: of the GIF
    """
    episodes, names = reading.episodes, reading.shape.names()
    env = drawn(level)
    if env is None:
        return
    lengths = np.where(episodes.successes, episodes.lengths, 0)
    shown = int(np.argmax(lengths.clip(max=SHOWN_LENGTH)))
    first, last = episodes.offsets[shown : shown + 2]
    env.reset(seed=int(episodes.seeds[shown]))
    mission = getattr(env.unwrapped, "mission", "")
    frames: list[Any] = []
    captions = []
    for message, action in zip(reading.messages[first:last], episodes.actions[first:last], strict=True):
        frames.append(env.render())
        captions.append(Caption(mission, names[message], reading.actions[action]))
        env.step(action)
    frames.append(env.render())
    captions.append(Caption(mission, "", ""))
    env.close()
    write_animation(path, frames, captions)


def drawn(level: str) -> gymnasium.Env | None:
    """:return: an environment that draws itself, None if it can't"""
    if is_level(level):
        return GuideGridEnv(level, render_mode="rgb_array")
    modes = gymnasium.make(level).metadata.get("render_modes") or ()
    return gymnasium.make(level, render_mode="rgb_array") if "rgb_array" in modes else None
