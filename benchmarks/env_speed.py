"""
Steps per second with random actions, resets included: `python -m benchmarks.env_speed --out speed.json`.

Ours goes through the SB3 VecEnv interface, with one and with two threads, and once through the bare kernel; Minigrid
through SB3's DummyVecEnv (without missions, which that cannot hold); EnvPool through its own interface, if it is installed.
Everything else runs on one core: the process is pinned to as many cores as there are threads.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3.common.vec_env import DummyVecEnv
from tqdm import tqdm

from benchmarks.versions import installed, versions
from sb3_guide.envs import ACTIONS, LEVELS, GuideGridVecEnv, level_of
from sb3_guide.envs.batch import Batch

Step = Callable[[np.ndarray], object]
ROUND = 16  # steps between two looks at the clock
ALL_CORES = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()


def ours(level: str, worlds: int) -> Step:
    """:return: a step of our VecEnv, without history, as Minigrid and EnvPool have none"""
    env = GuideGridVecEnv(level, worlds, seed=0, history=0)
    env.reset()
    return env.step


def ours_with_history(level: str, worlds: int) -> Step:
    """:return: a step of our VecEnv with its default history"""
    env = GuideGridVecEnv(level, worlds, seed=0)
    env.reset()
    return env.step


def ours_on_two_threads(level: str, worlds: int) -> Step:
    """:return: a step of our VecEnv that two threads share"""
    env = GuideGridVecEnv(level, worlds, seed=0, history=0, n_threads=2)
    env.reset()
    return env.step


def kernel(level: str, worlds: int) -> Step:
    """:return: a step without what SB3 asks for in Python: infos and last observations"""
    batch = Batch(level_of(level), worlds, history=0)
    batch.seed(range(worlds))
    batch.reset()
    return lambda actions: batch.step(actions, go_on=True)


def kernel_on_two_threads(level: str, worlds: int) -> Step:
    """:return: the same, shared by two threads"""
    batch = Batch(level_of(level), worlds, history=0, n_threads=2)
    batch.seed(range(worlds))
    batch.reset()
    return lambda actions: batch.step(actions, go_on=True)


def minigrid(level: str, worlds: int) -> Step:
    """:return: a step of Minigrid's envs in SB3's DummyVecEnv"""
    from minigrid.wrappers import ImgObsWrapper

    def make() -> gymnasium.Env:
        return ImgObsWrapper(gymnasium.make(f"BabyAI-{level}-v0", disable_env_checker=True))

    env = DummyVecEnv([make] * worlds)
    env.seed(0)
    env.reset()
    return env.step


def envpool(level: str, worlds: int) -> Step:
    """:return: a step of EnvPool, on one thread"""
    import envpool

    env = envpool.make_gymnasium(f"BabyAI-{level}-v0", num_envs=worlds, num_threads=1, seed=0)
    env.reset()
    return lambda actions: env.step(actions.astype(np.int32))


ENGINES = {
    engine.__name__: engine
    for engine in (ours, ours_with_history, ours_on_two_threads, kernel, kernel_on_two_threads, minigrid, envpool)
}


def steps_per_second(step: Step, worlds: int, seconds: float) -> float:
    """
    Time a step after a round to warm up.

    :param step: takes (worlds,) actions
    :param worlds: how many worlds step at once
    :param seconds: how long to measure
    :return: steps of single worlds per second
    """
    actions = np.random.default_rng(0).integers(len(ACTIONS), size=(ROUND, worlds))
    rounds, spent = -1, 0.0
    while spent < seconds:
        start = time.perf_counter()
        for row in actions:
            step(row)
        rounds += 1
        spent += time.perf_counter() - start if rounds else 0.0
    return rounds * ROUND * worlds / spent


def pin(cores: int) -> None:
    """Let the process run on so many cores only, where the system can do that."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, set(sorted(ALL_CORES)[:cores]))


def measure(levels: list[str], sizes: list[int], engines: list[str], seconds: float) -> list[dict[str, Any]]:
    """:return: a row for every engine, level and number of worlds"""
    rows: list[dict[str, Any]] = []
    cases = [(engine, level, worlds) for level in levels for worlds in sizes for engine in engines]
    for engine, level, worlds in tqdm(cases, disable=None):
        if engine in ("minigrid", "envpool") and level == "PutNext":
            continue  # neither has it
        pin(2 if engine.endswith("two_threads") else 1)
        with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):  # Minigrid prints every grid that it rejects
            speed = steps_per_second(ENGINES[engine](level, worlds), worlds, seconds)
        rows.append({"engine": engine, "level": level, "worlds": worlds, "steps_per_second": round(speed)})
        tqdm.write(f"{level:16} {worlds:5} worlds  {engine:24} {speed:14,.0f} steps/s")
    return rows


def table(rows: list[dict[str, Any]], worlds: int) -> str:
    """:return: Markdown, a row for every level: so many worlds of ours beside Minigrid's and EnvPool's"""
    speeds = {(row["engine"], row["level"]): row["steps_per_second"] for row in rows if row["worlds"] == worlds}
    names = (f"level, {worlds:,} worlds", "ours, steps/s", "Minigrid", "EnvPool", "times Minigrid", "times EnvPool")
    lines = [f"| {' | '.join(names)} |", "|---" * len(names) + "|"]
    for level in dict.fromkeys(level for _, level in speeds):
        us, *others = (speeds.get((engine, level)) for engine in ("ours", "minigrid", "envpool"))
        if us:
            cells = [f"{other:,.0f}" if other else "-" for other in (us, *others)]
            cells += [f"{us / other:,.1f}" if other else "-" for other in others]
            lines.append(f"| {level} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Measure what is asked for, print it, and write it down with the versions of everything that was measured."""
    parser = argparse.ArgumentParser(description="Steps per second of our levels, Minigrid's and EnvPool's.")
    parser.add_argument("--levels", nargs="+", default=list(LEVELS), help="names of levels")
    parser.add_argument("--worlds", nargs="+", type=int, default=[1, 64, 1024], help="how many worlds step at once")
    parser.add_argument("--engines", nargs="+", choices=list(ENGINES), default=list(ENGINES), help="what to measure")
    parser.add_argument("--seconds", type=float, default=2.0, help="for each measurement")
    parser.add_argument("--out", type=Path, help="JSON file for the results")
    arguments = parser.parse_args()
    engines = [engine for engine in arguments.engines if engine != "envpool" or installed("envpool")]
    levels = [level_of(level).name for level in arguments.levels]
    rows = measure(levels, arguments.worlds, engines, arguments.seconds)
    print("\n\n".join(table(rows, worlds) for worlds in sorted(arguments.worlds, reverse=True)))
    if arguments.out:
        report = {"machine": platform.processor() or platform.machine(), "versions": versions(), "speed": rows}
        arguments.out.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
