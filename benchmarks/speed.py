"""
Every speed beside its peer's, with all of this processor's instructions and with AVX2 alone:

    python -m benchmarks.speed --out docs/results/speed.json      # one core, nothing else running

Levels beside Minigrid's; PPO, A2C, RecurrentPPO and predict, for one world and with the settings that they come with, beside
SB3's and sb3-contrib's own policies; cloning beside stock imitation, which clones single frames with window memory. Peer and
ours take turns in one process, as a machine's speed drifts, and each kind of instructions has a process of its own. Speeds are
per second of CPU time. A ratio is the median over the turns, and its goal, where there is one, follows in brackets.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import asdict
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch as th
import typer
from gymnasium import spaces
from imitation.algorithms import bc
from imitation.data.types import DictObs
from imitation.util.logger import HierarchicalLogger
from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, PPO
from stable_baselines3.common.logger import Logger

from benchmarks.env_speed import minigrid, ours
from benchmarks.versions import processor, this_commit, versions
from sb3_guide.cloning import Demonstrations, load_demonstrations
from sb3_guide.cloning.bc import episode_bc
from sb3_guide.envs import ACTIONS, DEFAULT_HISTORY, level_of, observation_space
from sb3_guide.experiments.stages.record import record_demonstrations
from sb3_guide.experiments.stages.runs import use_threads
from sb3_guide.experts import expert_folder
from sb3_guide.files import read_json, write_json
from sb3_guide.policies import (
    AgentPolicy,
    LearnerPolicy,
    PretrainedGuide,
    RecurrentGuidedLearnerPolicy,
    RecurrentGuidePolicy,
    RecurrentLearnerPolicy,
)

Turn = Callable[[], float]  # does some work, and returns its speed
Contest = dict[str, Turn]  # by name, the peer first

PLACE = Path("runs/speed").absolute()  # of demonstrations and compiled code, for later calls too
AVX2 = {  # hides larger units from oneDNN, ATen, MKL, numba, numpy and its BLAS
    "ONEDNN_MAX_CPU_ISA": "AVX2",
    "ATEN_CPU_CAPABILITY": "avx2",
    "MKL_ENABLE_INSTRUCTIONS": "AVX2",
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "+avx2,+bmi,+bmi2,+fma",
    "NUMBA_CACHE_DIR": str(PLACE / "compiled_for_avx2"),
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_SKX AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Haswell",
}
KINDS: dict[str, dict[str, str]] = {"all": {}, "AVX2": AVX2}

LEARNER, GUIDE, GUIDED = "Learner", "Guide", "guided Learner"
POLICIES = {LEARNER: "LearnerPolicy", GUIDE: "GuidePolicy", GUIDED: "GuidedLearnerPolicy"}
CLONED: dict[str, type[AgentPolicy]] = {
    LEARNER: RecurrentLearnerPolicy,
    GUIDE: RecurrentGuidePolicy,
    GUIDED: RecurrentGuidedLearnerPolicy,
}
GOALS: dict[tuple[str, str], tuple[float, float]] = {  # times the peer: with all instructions, with AVX2
    ("levels, steps", "GuideGridVecEnv"): (615, 615),
    **{(f"{algorithm}, steps", agent): (0.6, 0.6) for algorithm in ("PPO", "A2C") for agent in (LEARNER, GUIDE)},
    **{("RecurrentPPO, steps", agent): (10, 10) for agent in (LEARNER, GUIDE)},
    ("PPO's predict, calls", LEARNER): (1, 1),
    ("PPO's predict, calls", GUIDE): (0.7, 0.7),
    ("cloning, batches of 256, frames", LEARNER): (3.64, 4),
    ("cloning, batches of 256, frames", GUIDE): (2.43, 2.5),
    ("cloning, batches of 256, frames", GUIDED): (1.48, 1.5),
    ("cloning, batches of 32, frames", LEARNER): (1.25, 1),
    ("cloning, batches of 32, frames", GUIDE): (0.82, 1),
    ("cloning, batches of 32, frames", GUIDED): (0.46, 1),
}

MANY_WORLDS, FEW_WORLDS = 1024, 8  # of ours, and of Minigrid's, where a step of each costs the same
STEPS, CALLS = 200, 200  # of a turn: of levels and A2C, and of predict
FRAMES = 2048  # in a batch of stock imitation
EPISODES = 1024  # demonstrations, of an epoch


def cpu_seconds(work: Callable[[], object]) -> float:
    """:return: that the work took"""
    start = time.process_time()
    work()
    return time.process_time() - start


def levels(level: str) -> Contest:
    """:return: steps of single worlds with random actions, resets included"""

    def turn(step: Callable[[np.ndarray], object], actions: np.ndarray) -> float:
        with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):  # Minigrid prints every grid that it rejects
            return actions.size / cpu_seconds(lambda: [step(row) for row in actions])

    actions = np.random.default_rng(0).integers(len(ACTIONS), size=(STEPS, MANY_WORLDS))
    return {
        "Minigrid in DummyVecEnv": partial(turn, minigrid(level, FEW_WORLDS), actions[:, :FEW_WORLDS]),
        "GuideGridVecEnv": partial(turn, ours(level, MANY_WORLDS), actions),
    }


def models(algorithm: Any, peer: str, level: str) -> dict[str, Any]:
    """:return: the algorithm as it comes, with its peer's policy and with ours"""
    guide = asdict(PretrainedGuide.untrained().description)
    if algorithm is not RecurrentPPO:
        guide |= {"policy": "GuidePolicy", "history": DEFAULT_HISTORY}
    return {
        name: algorithm(policy, level_of(level).env_id, seed=0, policy_kwargs={"guide": guide} if name == GUIDED else None)
        for name, policy in {peer: peer, **POLICIES}.items()
    }


def training(algorithm: Any, peer: str, level: str) -> Contest:
    """:return: steps, collected and trained on; of the epochs on the same rollout one is run, and counts as all of them"""

    def turn(model: Any, train: Callable[[], None], epochs: int) -> float:
        spent: list[float] = []
        model.train, model.n_epochs = lambda: spent.append(cpu_seconds(train)), 1
        steps = model.n_steps * (STEPS // model.n_steps or 1)
        return steps / (cpu_seconds(lambda: model.learn(steps)) + (epochs - 1) * sum(spent))

    built = models(algorithm, peer, level)
    return {name: partial(turn, model, model.train, getattr(model, "n_epochs", 1)) for name, model in built.items()}


def predicting(algorithm: Any, peer: str, level: str) -> Contest:
    """:return: calls for one world, each with another observation"""

    def turn(model: Any, seen: list[Any]) -> float:
        state = None

        def play() -> None:
            nonlocal state
            for observation in seen:
                _, state = model.predict(observation, state)

        return CALLS / cpu_seconds(play)

    def observations(env: Any) -> list[Any]:
        env.reset()
        return [env.step(env.action_space.sample()[None])[0] for _ in range(CALLS)]

    return {name: partial(turn, model, observations(model.env)) for name, model in models(algorithm, peer, level).items()}


def transitions(demonstrations: Demonstrations) -> list[dict[str, Any]]:
    """:return: batches of single frames with the images before them, in an order of their own"""
    episodes = demonstrations.episodes
    frame = np.arange(len(episodes.actions))
    first = np.repeat(episodes.offsets[:-1], episodes.lengths)
    before = frame[:, None] + np.arange(-DEFAULT_HISTORY, 0)  # (F, history)
    history = episodes.images[before.clip(min=0)] * (before >= first[:, None])[..., None, None, None]
    missions = np.repeat(episodes.missions, episodes.lengths, axis=0)
    order = np.random.default_rng(0).permutation(len(frame) // FRAMES * FRAMES).reshape(-1, FRAMES)
    return [
        {
            "obs": DictObs({"image": episodes.images[rows], "mission": missions[rows], "history": history[rows]}),
            "acts": episodes.actions[rows].astype(np.int64),
        }
        for rows in order
    ]


def cloning(level: str, size: str, batch_size: int, arithmetic: str | None = None) -> Contest:
    """:return: frames, in epochs; ours in batches of so many episodes"""
    use_threads(1)  # as all stages: the same sums each time
    demonstrations = load_demonstrations(demonstrations_of(level))
    logger = HierarchicalLogger(Logger(folder=None, output_formats=[]))

    def untrained(policy: type[AgentPolicy], history: int, **arguments: Any) -> AgentPolicy:
        space, actions = observation_space(history), spaces.Discrete(len(ACTIONS))
        return policy(space, actions, lambda _: 1e-3, ortho_init=False, size=size, **arguments)

    def turn(algorithm: bc.BC, frames: int) -> float:
        return frames / cpu_seconds(lambda: algorithm.train(n_epochs=1, progress_bar=False))

    def stock() -> Turn:
        policy, batches = untrained(LearnerPolicy, DEFAULT_HISTORY), transitions(demonstrations)
        spaces_of = {"observation_space": policy.observation_space, "action_space": policy.action_space}
        loop = {"rng": np.random.default_rng(0), "demonstrations": batches, "batch_size": FRAMES, "custom_logger": logger}
        return partial(turn, bc.BC(policy=policy, **spaces_of, **loop), len(batches) * FRAMES)

    def whole_episodes(agent: str) -> Turn:
        policy = untrained(CLONED[agent], 0, **({"guide": PretrainedGuide.untrained(size=size)} if agent == GUIDED else {}))
        settings: dict[str, Any] = {"batch_size": batch_size, "learning_rate": 1e-3, "ent_weight": 0.01, "seed": 0}
        algorithm, loader = episode_bc(policy, demonstrations, arithmetic=arithmetic, logger=logger, **settings)
        return partial(turn, algorithm, sum(int(batch["obs"].get("length").sum()) for batch in loader))

    return {"stock imitation": stock(), **{agent: whole_episodes(agent) for agent in CLONED}}


def contests(level: str, size: str) -> dict[str, Callable[[], Contest]]:
    """:return: what is compared, by name"""
    stock, recurrent = "MultiInputPolicy", "MultiInputLstmPolicy"
    return {
        "levels, steps": partial(levels, level),
        "PPO's predict, calls": partial(predicting, PPO, stock, level),
        "RecurrentPPO's predict, calls": partial(predicting, RecurrentPPO, recurrent, level),
        "PPO, steps": partial(training, PPO, stock, level),
        "A2C, steps": partial(training, A2C, stock, level),
        "RecurrentPPO, steps": partial(training, RecurrentPPO, recurrent, level),
        "cloning, batches of 256, frames": partial(cloning, level, size, 256),
        "cloning, batches of 32, frames": partial(cloning, level, size, 32),
        "cloning, batches of 256, always in bfloat16, frames": partial(cloning, level, size, 256, "bfloat16"),
    }


def demonstrations_of(level: str) -> Path:
    """:return: file of episodes of the level's expert, recorded where there is none"""
    file = PLACE / f"{level}.safetensors"
    if not file.exists():
        record_demonstrations(level, expert_folder(level), "train", EPISODES, file, threads=1)
    return file


def matmul_gigaflops() -> float:
    """:return: GFLOP/s of multiplying square matrices of 32 bits, the best of ten"""
    matrix = th.randn(1024, 1024)
    return 2 * 1024**3 / min(cpu_seconds(lambda: matrix @ matrix) for _ in range(10)) / 1e9


def measure(level: str, size: str, turns: int, only: str) -> dict[str, Any]:
    """:return: a row for each of ours, and what this process takes the processor for"""
    th.set_num_threads(1)
    rows: list[dict[str, Any]] = []
    for what, build in contests(level, size).items():
        if only not in what:
            continue
        peer, *agents = contest = build()
        speeds = np.array([[turn() for turn in contest.values()] for _ in range(turns)])  # a median leaves out the first
        for agent, of_agent in zip(agents, speeds.T[1:], strict=True):
            low, times, high = np.quantile(of_agent / speeds[:, 0], [0.25, 0.5, 0.75]).round(3).tolist()
            medians = {"peer_per_second": round(np.median(speeds[:, 0])), "per_second": round(np.median(of_agent))}
            rows.append({"what": what, "agent": agent, "peer": peer, **medians, "times": times, "quartiles": [low, high]})
            print(f"{what:52} {agent:15} {medians['per_second']:>9,} {times:7.2f} ({low:.2f} to {high:.2f})", file=sys.stderr)
    return {"capability": th.backends.cpu.get_cpu_capability(), "matmul_gigaflops": round(matmul_gigaflops()), "rows": rows}


def table(kinds: dict[str, dict[str, Any]]) -> str:
    """:return: Markdown, a row for each of ours"""
    names = [f"{part}, {kind}" for kind in kinds for part in ("peer's", "ours", "times (goal)")]
    lines = [f"| a second of | agent | peer | {' | '.join(names)} |", "|---" * (3 + len(names)) + "|"]
    for alike in zip(*(kind["rows"] for kind in kinds.values()), strict=True):
        cells = [alike[0][name] for name in ("what", "agent", "peer")]
        goals = GOALS.get((cells[0], cells[1]), (None, None))
        for row, goal in zip(alike, goals, strict=True):
            aimed = f" ({goal:g})" if goal else ""
            cells += [f"{row['peer_per_second']:,}", f"{row['per_second']:,}", f"{row['times']:.2f}{aimed}"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def main(
    out: Annotated[Path, typer.Option(help="JSON file for the results.")],
    level: Annotated[str, typer.Option(help="Where everything is measured.")] = "GoToLocal",
    size: Annotated[str, typer.Option(help="Of the agents that are cloned.")] = "compact",
    turns: Annotated[int, typer.Option(help="Of each; the first also warms up.")] = 5,
    only: Annotated[str, typer.Option(help="Rows with this in their names.")] = "",
    alone: Annotated[bool, typer.Option(help="In this process, with what instructions it has.")] = False,
) -> None:
    """Measure with each kind of instructions, and print the table."""
    if alone:
        write_json(out, measure(level, size, turns, only))
        return
    demonstrations_of(level)
    settings = ["--level", level, "--size", size, "--turns", str(turns), "--only", only, "--out", str(out)]
    kinds = {}
    for kind, variables in KINDS.items():
        command = [sys.executable, "-m", "benchmarks.speed", *settings, "--alone"]
        subprocess.run(command, check=True, env={**os.environ, **variables})
        kinds[kind] = read_json(out)
    print(table(kinds))
    made_by = {"processor": processor(), "versions": versions(), "commit": this_commit()}
    date = f"{datetime.now(timezone.utc):%Y-%m-%d}"
    write_json(out, {**made_by, "date": date, "level": level, "size": size, "turns": turns, "kinds": kinds})


if __name__ == "__main__":
    typer.run(main)
