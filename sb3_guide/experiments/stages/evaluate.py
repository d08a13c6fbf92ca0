"""How often an agent succeeds on missions that nothing was trained or chosen on."""

import time
from pathlib import Path

from tqdm import tqdm

from sb3_guide.cloning import mission_seeds, play
from sb3_guide.envs import level_of
from sb3_guide.experiments.stages.runs import record, use_threads
from sb3_guide.experiments.stages.statistics import wilson_interval
from sb3_guide.policies import load_agent
from sb3_guide.policies.folder import write_json


def evaluate(agent: Path, level: str, n_episodes: int, out: Path, threads: int) -> None:
    """
    :param agent: folder of the agent
    :param level: name of the level
    :param n_episodes: missions to play, from the analysis split
    :param out: JSON file to write
    :param threads: of torch
    :raises ValueError: if an argument is out of range
    """
    level, seeds = level_of(level).name, mission_seeds("analysis", n_episodes)
    use_threads(threads)
    started = time.monotonic()
    policy = load_agent(agent)
    with tqdm(total=n_episodes, desc=f"evaluate {type(policy).__name__}", unit="episode") as progress:
        episodes = play(policy, level, seeds, progress.update)
    successes = int(episodes.successes.sum())
    low, high = wilson_interval(successes, n_episodes)
    found = {
        "agent": type(policy).__name__,
        "episodes": n_episodes,
        "successes": successes,
        "success_rate": successes / n_episodes,
        "low": low,
        "high": high,
        "mean_length": float(episodes.lengths.mean()),
        "first_seed": int(seeds[0]),
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    settings = {"level": level, "folder": str(agent), "threads": threads}
    write_json(out, {**record("evaluate", settings, time.monotonic() - started), **found})
