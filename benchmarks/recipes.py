"""
How long the experts' recipes take, seed by seed: `python -m benchmarks.recipes --seeds 3 --out runs/recipes`.

Runs `sb3-guide expert`, with whatever options it is given besides its own, for each level and seed, evaluates what comes of
it on fresh missions, beside Minigrid's bot, and prints a row for each. What is there already is not run again.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.experts import of_bot, of_expert
from sb3_guide.cloning import mission_seeds
from sb3_guide.experiments.stages.runs import read_table
from sb3_guide.files import read_json, write_json
from sb3_guide.policies import load_agent


def processor_seconds() -> float:
    """:return: that finished children of this process have computed"""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def train(level: str, seed: int, folder: Path, options: list[str]) -> dict[str, float]:
    """:return: seconds that the command took, and that it computed; the expert is in the folder then"""
    wall, processor = time.monotonic(), processor_seconds()
    command = ["expert", "--level", level, "--seed", str(seed), "--out", str(folder), *options]
    subprocess.run([sys.executable, "-m", "sb3_guide.experiments.cli", *command], check=True)
    return {"wall_seconds": time.monotonic() - wall, "cpu_seconds": processor_seconds() - processor}


def measure(level: str, seed: int, folder: Path, options: list[str], n_episodes: int) -> dict[str, Any]:
    """:return: what the recipe took and gave; also written beside the expert"""
    took, policy, seeds = train(level, seed, folder, options), load_agent(folder), mission_seeds("analysis", n_episodes)
    rows = read_table(folder / "progress.csv")
    bot_success, bot_length = of_bot(level, seeds)
    before_the_last = [row for row in rows if row["curriculum/part"] != rows[-1]["curriculum/part"]]
    found = {
        "level": level,
        "seed": seed,
        "frames": read_json(folder / "run.json")["frames"],
        "frames_before_the_last_part": int(before_the_last[-1]["time/total_timesteps"]) if before_the_last else 0,
        **took,
        "drawn": of_expert(policy, level, seeds, deterministic=False),
        "greedy": of_expert(policy, level, seeds, deterministic=True),
        "bot_success": bot_success,
        "bot_length": bot_length,
    }
    write_json(folder / "recipe.json", found)
    return found


def row(found: dict[str, Any]) -> str:
    """:return: of the table"""
    seconds = f"{found['cpu_seconds']:.0f} | {found['wall_seconds']:.0f}"
    rates = " | ".join(f"{found[way]['success_rate']:.1%} | {found[way]['mean_length']:.1f}" for way in ("drawn", "greedy"))
    bot = f"{found['bot_success']:.1%} | {found['bot_length']:.1f}"
    frames = f"{found['frames_before_the_last_part']:,} | {found['frames']:,}"
    return f"| {found['level']} | {found['seed']} | {frames} | {seconds} | {rates} | {bot} |"


def main() -> None:
    """Run what is missing and print all."""
    parser = argparse.ArgumentParser(description="Train experts by their recipes. Other options go to sb3-guide expert.")
    parser.add_argument("--levels", nargs="+", default=["GoToObj", "GoToLocal", "PickupLoc", "PutNextLocal"])
    parser.add_argument("--seeds", type=int, default=3, help="how many of each level, from 0 on")
    parser.add_argument("--episodes", type=int, default=1000, help="missions to evaluate on")
    parser.add_argument("--out", type=Path, required=True, help="folder for the experts")
    arguments, options = parser.parse_known_args()
    print("| level | seed | frames before the last part | frames | CPU s | wall s | drawn | steps | greedy | steps |", end="")
    print(" bot | steps |")
    print("|---" * 12 + "|")
    for level in arguments.levels:
        for seed in range(arguments.seeds):
            folder = arguments.out / f"{level}-{seed}"
            done = folder / "recipe.json"
            found = read_json(done) if done.exists() else measure(level, seed, folder, options, arguments.episodes)
            print(row(found), flush=True)


if __name__ == "__main__":
    main()
