"""
Long runs of our levels against Minigrid's: `python -m benchmarks.parity --level all --steps 1000000`.

Compares image, direction, mission, reward, terminated, truncated and the generator's state after every step.
"""

from __future__ import annotations

import argparse
import sys

from tqdm import trange

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
    parser.add_argument("--level", default="all", help="a level's name, or all")
    parser.add_argument("--steps", type=int, default=100_000, help="steps a level")
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    arguments = parser.parse_args()
    if arguments.steps < 1:
        parser.error(f"--steps {arguments.steps}: expected at least 1")
    levels = list(LEVELS) if arguments.level == "all" else [level_of(arguments.level).name]
    differences = 0
    for level in levels:
        difference = compare(level, arguments.steps, arguments.seed)
        differences += difference is not None
        print(difference or f"{level}: {arguments.steps} steps identical", flush=True)
    sys.exit(differences > 0)


if __name__ == "__main__":
    main()
