"""How often an agent succeeds on missions that nothing was trained or chosen on."""

import time
from pathlib import Path

from tqdm import tqdm

from sb3_guide.cloning import mission_seeds, play
from sb3_guide.cloning.episodes import concatenate
from sb3_guide.experiments.stages.levels import join_levels, split_levels
from sb3_guide.experiments.stages.runs import check_result, record, use_threads
from sb3_guide.experiments.stages.statistics import wilson_interval
from sb3_guide.files import write_json
from sb3_guide.policies import load_agent


def evaluate(agent: Path, level: str, n_episodes: int, out: Path, threads: int) -> None:
    """
    :param agent: folder of the agent
    :param level: name of the level, or several joined by "+", whose missions all count
    :param n_episodes: missions of each level to play, from the analysis split
    :param out: JSON file to write
    :param threads: of torch
    :raises ValueError: if an argument is out of range, or the file holds something else
    """
    check_result(out, "evaluate")
    levels, seeds = split_levels(level), mission_seeds("analysis", n_episodes)
    use_threads(threads)
    started = time.monotonic()
    policy = load_agent(agent)
    with tqdm(total=len(levels) * n_episodes, desc=f"evaluate {type(policy).__name__}", unit="episode") as progress:
        episodes = concatenate([play(policy, name, seeds, progress.update) for name in levels])
    successes = int(episodes.successes.sum())
    low, high = wilson_interval(successes, len(episodes))
    found = {
        "agent": type(policy).__name__,
        "episodes": len(episodes),
        "successes": successes,
        "success_rate": successes / len(episodes),
        "low": low,
        "high": high,
        "mean_length": float(episodes.lengths.mean()),
        "first_seed": int(seeds[0]),
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    settings = {"level": join_levels(levels), "folder": str(agent), "threads": threads}
    write_json(out, {**record("evaluate", settings, time.monotonic() - started), **found})
