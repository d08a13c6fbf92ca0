"""Demonstrations of an expert."""

import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
from tqdm import tqdm

from sb3_guide.cloning import Demonstrations, mission_seeds, play, save_demonstrations
from sb3_guide.cloning.demonstrations import check_place
from sb3_guide.cloning.episodes import Episodes, concatenate
from sb3_guide.experiments.stages.levels import environment
from sb3_guide.experiments.stages.runs import alone, check_result, record, use_threads
from sb3_guide.files import write_json
from sb3_guide.policies import AgentPolicy, load_agent
from sb3_guide.policies.agents import LearnerAgent
from sb3_guide.policies.folder import read_agent

WORST_EXPERT = 0.5  # share of missions below which recording would take forever


def record_demonstrations(level: str, expert: Path, split: str, n_episodes: int, out: Path, threads: int) -> None:
    """
    Play missions until enough of them have succeeded, and keep these.

    :param level: see :func:`~sb3_guide.experiments.stages.levels.environment`
    :param expert: folder of a Learner
    :param split: "train", "validation" or "analysis"
    :param n_episodes: to be kept
    :param out: file of the demonstrations; a record of the run is written beside it
    :param threads: of torch
    :raises RuntimeError: if another call writes that file
    :raises ValueError: if the expert fails most missions, an argument is out of range, or the file holds something else
    """
    beside = out.with_suffix(".json")
    check_place(out)
    check_result(beside, "record")
    level = environment(level)
    mission_seeds(split, n_episodes)  # complains before anything is loaded
    use_threads(threads)
    started = time.monotonic()
    policy = load_agent(expert, LearnerAgent)
    out.parent.mkdir(parents=True, exist_ok=True)
    with alone(out, out.with_name(f"{out.name}.lock")):
        episodes, played = successful_episodes(policy, level, split, n_episodes)
        provenance = {
            "split": split,
            "first_seed": int(episodes.seeds[0]),
            "missions_played": played,
            "expert": asdict(read_agent(expert)[0]),
        }
        save_demonstrations(Demonstrations(episodes, level, provenance), out)
        settings = {"level": level, "split": split, "threads": threads, "expert": str(expert)}
        found = {
            "episodes": len(episodes),
            "frames": len(episodes.actions),
            "mean_length": float(episodes.lengths.mean()),
            "expert_success_rate": len(episodes) / played,
        }
        write_json(beside, {**record("record", settings, time.monotonic() - started), **found})


def successful_episodes(policy: AgentPolicy, level: str, split: str, n_episodes: int) -> tuple[Episodes, int]:
    """
    :param policy: of the expert
    :param level: name of the level
    :param split: of the missions
    :param n_episodes: to be kept
    :return: the first so many successful episodes, and how many missions it took
    :raises ValueError: if the expert fails most missions
    """
    parts: list[Episodes] = []
    played = kept = 0
    with tqdm(total=n_episodes, desc=f"record {split}", unit="episode") as progress:
        while kept < n_episodes:
            episodes = play(policy, level, mission_seeds(split, n_episodes - kept, skip=played), progress.update)
            played += len(episodes)
            parts.append(episodes.select(np.flatnonzero(episodes.successes)))
            kept += len(parts[-1])
            progress.update(kept - progress.n)
            if kept < WORST_EXPERT * played:
                raise ValueError(f"the expert solved {kept} of {played} missions of {level}: train it longer before recording")
    return concatenate(parts), played
