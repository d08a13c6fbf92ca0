"""
Long runs of our levels against Minigrid's: `python -m benchmarks.parity --steps 1000000 --out parity.json`.

Compares image, direction, mission, reward, terminated, truncated and the generator's state after every step.
"""

from __future__ import annotations

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from pathlib import Path

from tqdm import trange

from benchmarks.versions import versions
from sb3_guide.envs import LEVELS, level_of
from tests.envs.oracle import first_difference

STEPS_PER_SEED = 10_000


def compare(level: str, steps: int, seed: int) -> str | None:
    """
    :param level: name of the level
    :param steps: at least so many, in runs of 10 000 with a seed each
    :param seed: the first one
    :return: the first difference, or None
    """
    for run in trange(-(-steps // STEPS_PER_SEED), desc=level, unit="run", disable=None):
        difference = first_difference(level, seed + run, min(steps, STEPS_PER_SEED))
        if difference:
            return difference
    return None


def main() -> None:
    """Compare the levels that are asked for; the exit status is 1 if any differs."""
    parser = argparse.ArgumentParser(description="Compare our levels with Minigrid's, step by step.")
    parser.add_argument("--level", nargs="+", default=["all"], help="names of levels, or all")
    parser.add_argument("--steps", type=int, default=100_000, help="steps a level")
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=1, help="how many levels to compare at once")
    parser.add_argument("--out", type=Path, help="JSON file for the results, written after every level")
    arguments = parser.parse_args()
    if arguments.steps < 1 or arguments.jobs < 1:
        parser.error(f"--steps {arguments.steps} --jobs {arguments.jobs}: expected at least 1 of both")
    levels = list(LEVELS) if arguments.level == ["all"] else [level_of(level).name for level in arguments.level]
    report = {"versions": versions(), "steps_a_level": arguments.steps, "first_seed": arguments.seed}
    differences: dict[str, str | None] = {}
    with ProcessPoolExecutor(arguments.jobs) as pool:
        found = pool.map(compare, levels, repeat(arguments.steps), repeat(arguments.seed))
        for level, difference in zip(levels, found, strict=True):
            differences[level] = difference
            print(difference or f"{level}: {arguments.steps} steps identical", flush=True)
            if arguments.out:
                arguments.out.write_text(json.dumps({**report, "first_difference": differences}, indent=1) + "\n")
    sys.exit(any(differences.values()))


if __name__ == "__main__":
    main()
