"""
What the engine costs around a step, and what bounds one: `python -m benchmarks.engine_cost --out cost.json`.

Seconds to import the package on top of torch, SB3 and numba, and to the end of the first step with an empty and with a
filled cache of compiled code. Then, of a step of one world among many: its time, the instructions and the bytes fetched from
beyond a second-level cache as valgrind counts them (if it is installed), and the bandwidth of a plain copy of memory.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from tqdm import tqdm

import sb3_guide
from benchmarks.env_speed import kernel, steps_per_second
from benchmarks.versions import versions
from sb3_guide.envs import level_of

WORLDS = 16384  # more than any cache holds
FEW, MANY = 5, 25  # steps of two runs, whose difference is free of what happens before the first step
LINE, L1, L2 = 64, "32768,8,64", "2097152,16,64"  # bytes; caches that valgrind simulates
COPIED = 1 << 28  # bytes

IMPORT = """
import time, torch, stable_baselines3, sb3_contrib, numba
start = time.perf_counter()
import sb3_guide
print(time.perf_counter() - start)
"""
FIRST_USE = """
import time, numpy, sb3_guide
start = time.perf_counter()
env = sb3_guide.GuideGridVecEnv("GoToObj", 1, seed=0)
env.reset()
env.step(numpy.zeros(1, dtype=int))
print(time.perf_counter() - start)
"""
# Only the engine, without the packages around it: valgrind slows everything down fifty times.
STEPS = """
import sys, types
folder, level, worlds, steps = sys.argv[1:]
for name, path in (("sb3_guide", folder), ("sb3_guide.envs", folder + "/envs")):
    sys.modules[name] = types.ModuleType(name)
    sys.modules[name].__path__ = [path]
import numpy as np
from sb3_guide.envs.engine.kernel import Observations, Outcomes, entry_points
from sb3_guide.envs.engine.state import WORLD
from sb3_guide.envs.levels import level_of
from sb3_guide.envs.seeding import streams
count, rules = int(worlds), level_of(level).rules()
worlds, frames = np.zeros(count, dtype=WORLD), np.zeros((count, 0), dtype=np.uint8)
worlds["stream"] = streams(np.arange(count, dtype=np.uint64))
out, last = (Observations(*(np.zeros((count, width), dtype=np.uint8) for width in (147, 0, 72))) for _ in range(2))
outcomes = Outcomes(np.zeros(count), np.zeros(count, dtype=bool), np.zeros(count, dtype=bool))
entry_points().reset(0, count, worlds, rules, frames, out)
for actions in np.random.default_rng(0).integers(7, size=(int(steps), count)):
    entry_points().step(0, count, True, worlds, rules, actions, frames, out, last, outcomes)
"""


def run(command: list[str], **environment: str) -> str:
    """:return: what a new process writes, errors included"""
    settings = {**os.environ, **environment}
    return subprocess.run(command, check=True, env=settings, text=True, stdout=-1, stderr=subprocess.STDOUT).stdout


def seconds(program: str, **environment: str) -> float:
    """:return: the number that a program prints last, when it runs in a new process"""
    return float(run([sys.executable, "-c", program], **environment).split()[-1])


def copy_bandwidth() -> float:
    """:return: bytes that a copy of memory reads and writes per second, at best"""
    source, target = np.ones(COPIED, dtype=np.uint8), np.zeros(COPIED, dtype=np.uint8)
    durations = []
    for _ in range(10):
        start = time.perf_counter()
        np.copyto(target, source)
        durations.append(time.perf_counter() - start)
    return 2 * COPIED / min(durations)


def counted(level: str, cache: str) -> dict[str, float]:
    """
    Let valgrind count, with instructions up to AVX2, which is what it knows.

    :param level: name of the level
    :param cache: folder for code compiled that way
    :return: instructions of a step of one world, and bytes fetched from beyond the second cache
    """
    valgrind = ["valgrind", "--tool=cachegrind", "--cachegrind-out-file=/dev/null", "--smc-check=all-non-file"]
    valgrind += [f"--I1={L1}", f"--D1={L1}", f"--LL={L2}"]
    environment = {"NUMBA_CACHE_DIR": cache, "NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+bmi,+bmi2,+fma"}
    counts = []
    for steps in (1, FEW, MANY):  # the first run only compiles
        play = [sys.executable, "-c", STEPS, str(Path(sb3_guide.__file__).parent), level, str(WORLDS), str(steps)]
        written = run(valgrind * (steps > 1) + play, **environment)
        counts.append([int(re.sub(",", "", number)) for number in re.findall(r"(?:I +refs|LLd misses): +([\d,]+)", written)])
    instructions, misses = (np.subtract(counts[2], counts[1]) / (MANY - FEW) / WORLDS).tolist()
    return {"instructions": instructions, "bytes_from_beyond_the_second_cache": misses * LINE}


def main() -> None:
    """Measure, print and write down."""
    parser = argparse.ArgumentParser(description="What the engine costs around a step, and what bounds one.")
    parser.add_argument("--levels", nargs="+", default=["GoToObj", "GoTo"], help="names of levels")
    parser.add_argument("--out", type=Path, help="JSON file for the results")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as cache:
        report: dict[str, object] = {
            "versions": versions(),
            "import_seconds": min(seconds(IMPORT) for _ in range(3)),
            "first_use_seconds": seconds(FIRST_USE, NUMBA_CACHE_DIR=cache),
            "later_use_seconds": min(seconds(FIRST_USE, NUMBA_CACHE_DIR=cache) for _ in range(3)),
            "copy_bytes_per_second": copy_bandwidth(),
        }
    levels = [level_of(level).name for level in arguments.levels]
    steps = {level: {"nanoseconds": 1e9 / steps_per_second(kernel(level, WORLDS), WORLDS, 2.0)} for level in levels}
    with tempfile.TemporaryDirectory() as cache:
        for level in tqdm(levels if shutil.which("valgrind") else (), disable=None):
            steps[level] |= counted(level, cache)
    report[f"a_step_among_{WORLDS}_worlds"] = steps
    text = json.dumps(report, indent=1)
    print(text)
    if arguments.out:
        arguments.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
