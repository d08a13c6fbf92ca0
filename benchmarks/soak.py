"""Whether memory stays flat in long runs: `python -m benchmarks.soak --steps 10000000`. Needs Linux's /proc."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import numpy as np
from tqdm import tqdm

from sb3_guide.envs import ACTIONS, LEVELS, GuideGridVecEnv, level_of

WORLDS = 1024
WARM_UP = 0.1  # of all steps, for the allocator to settle
TOLERANCE = 2.0  # megabytes


def resident() -> float:
    """:return: megabytes of memory that the process holds"""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def growth(level: str, steps: int) -> float:
    """
    Step at random, episodes ending and beginning.

    :param level: name of the level
    :param steps: of single worlds
    :return: megabytes by which memory grew after the warm-up
    """
    env = GuideGridVecEnv(level, WORLDS, seed=0)
    env.reset()
    rng = np.random.default_rng(0)
    rounds = max(steps // WORLDS, 1)
    before = resident()
    for index in tqdm(range(rounds), desc=level, unit="step", disable=None):
        env.step(rng.integers(len(ACTIONS), size=WORLDS))
        if index == int(rounds * WARM_UP):
            before = resident()
    return resident() - before


def main() -> None:
    """Print a line for every level; the exit status is 1 if memory grew."""
    parser = argparse.ArgumentParser(description="Step for long and watch memory.")
    parser.add_argument("--levels", nargs="+", default=list(LEVELS), help="names of levels")
    parser.add_argument("--steps", type=int, default=10_000_000, help="steps a level")
    arguments = parser.parse_args()
    grown = {level_of(level).name: growth(level, arguments.steps) for level in arguments.levels}
    for level, megabytes in grown.items():
        print(f"{level}: {megabytes:+.1f} MB after {arguments.steps} steps")
    sys.exit(any(megabytes > TOLERANCE for megabytes in grown.values()))


if __name__ == "__main__":
    main()
