"""
Every speed as a ratio to its peer's, with all of this processor's instructions and with AVX2 alone:

    python -m benchmarks.speed --out docs/results/speed.json      # one core, nothing else running

Levels beside Minigrid's; PPO, A2C, RecurrentPPO and predict, for one world and with the settings that they come with, beside
SB3's and sb3-contrib's own policies; cloning beside stock imitation, which clones single frames with window memory. Peer and
ours take turns in one process, as a machine's speed drifts, and each kind of instructions has a process of its own. Speeds are
per second of CPU time, a ratio is the median over the turns. Where a ratio has a goal, it follows in brackets.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import asdict
from datetime import datetime, timezone
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
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from tqdm import tqdm

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

Turn = Callable[[], int]  # does some work, and says how much: steps, calls or frames

PLACE = Path("runs/speed")  # of demonstrations and compiled code, which later calls use again
AVX2 = {  # what hides larger units from oneDNN, ATen, MKL, numba, numpy and its BLAS
    "ONEDNN_MAX_CPU_ISA": "AVX2",
    "ATEN_CPU_CAPABILITY": "avx2",
    "MKL_ENABLE_INSTRUCTIONS": "AVX2",
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "+avx2,+bmi,+bmi2,+fma",
    "NUMBA_CACHE_DIR": str(PLACE.absolute() / "compiled_for_avx2"),
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
# Times the peer, by row and agent: with all instructions, with AVX2
GOALS: dict[tuple[str, str], tuple[float, float]] = {
    ("levels, steps", "GuideGridVecEnv"): (615, 615),
    **{(f"{name}, steps", agent): (0.6, 0.6) for name in ("PPO", "A2C") for agent in (LEARNER, GUIDE)},
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
STEPS, CALLS = 500, 200  # of a turn of levels and of A2C, and of predict
FRAMES = 2048  # in a batch of stock imitation's
EPISODES = 2048  # demonstrations


def levels(level: str) -> dict[str, Turn]:
    """:return: steps with random actions, resets included"""

    def turn_of(step: Callable[[np.ndarray], object], worlds: int) -> Turn:
        actions = np.random.default_rng(0).integers(len(ACTIONS), size=(STEPS, worlds))

        def turn() -> int:
            with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):  # Minigrid prints every grid that it rejects
                for row in actions:
                    step(row)
            return actions.size

        return turn

    theirs = turn_of(minigrid(level, FEW_WORLDS), FEW_WORLDS)
    return {"Minigrid in DummyVecEnv": theirs, "GuideGridVecEnv": turn_of(ours(level, MANY_WORLDS), MANY_WORLDS)}


def models(algorithm: Callable[..., OnPolicyAlgorithm], peer: str, level: str) -> dict[str, OnPolicyAlgorithm]:
    """:return: the algorithm as it comes, with its peer's policy and with ours"""
    guide = asdict(PretrainedGuide.untrained().description)
    if algorithm is not RecurrentPPO:
        guide |= {"policy": "GuidePolicy", "history": DEFAULT_HISTORY}
    known = {GUIDED: {"guide": guide}}
    policies = {peer: peer, **POLICIES}
    return {
        name: algorithm(policy, level_of(level).env_id, seed=0, device="cpu", policy_kwargs=known.get(name))
        for name, policy in policies.items()
    }


def training(algorithm: Callable[..., OnPolicyAlgorithm], peer: str, level: str) -> dict[str, Turn]:
    """:return: whole rollouts, collected and trained on"""

    def turn_of(model: OnPolicyAlgorithm) -> Turn:
        steps = model.n_steps * (STEPS // model.n_steps or 1)

        def turn() -> int:
            model.learn(steps)
            return steps

        return turn

    return {name: turn_of(model) for name, model in models(algorithm, peer, level).items()}


def predicting(algorithm: Callable[..., OnPolicyAlgorithm], peer: str, level: str) -> dict[str, Turn]:
    """:return: calls for one world, each with another observation"""

    def turn_of(model: OnPolicyAlgorithm) -> Turn:
        env = model.get_env()
        assert env is not None
        env.reset()
        seen: list[Any] = [env.step(env.action_space.sample()[None])[0] for _ in range(CALLS)]

        def turn() -> int:
            state = None
            for observation in seen:
                _, state = model.predict(observation, state)
            return CALLS

        return turn

    return {name: turn_of(model) for name, model in models(algorithm, peer, level).items()}


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


def cloning(level: str, size: str, batch_size: int, arithmetic: str | None = None) -> dict[str, Turn]:
    """:return: epochs"""
    use_threads(1)  # as every stage does: the same sums each time
    demonstrations = load_demonstrations(demonstrations_of(level))
    logger = HierarchicalLogger(Logger(folder=None, output_formats=[]))

    def untrained(policy: type[AgentPolicy], history: int, **arguments: Any) -> AgentPolicy:
        space, actions = observation_space(history), spaces.Discrete(len(ACTIONS))
        return policy(space, actions, lambda _: 1e-3, ortho_init=False, size=size, **arguments)

    def stock() -> Turn:
        policy, batches = untrained(LearnerPolicy, DEFAULT_HISTORY), transitions(demonstrations)
        algorithm = bc.BC(
            observation_space=policy.observation_space,
            action_space=policy.action_space,
            rng=np.random.default_rng(0),
            policy=policy,
            demonstrations=batches,
            batch_size=FRAMES,
            custom_logger=logger,
        )
        return turn_of(algorithm, len(batches) * FRAMES)

    def whole_episodes(agent: str) -> Turn:
        guide = {"guide": PretrainedGuide.untrained(size=size)} if agent == GUIDED else {}
        algorithm, loader = episode_bc(
            untrained(CLONED[agent], 0, **guide),
            demonstrations,
            batch_size=batch_size,
            learning_rate=1e-3,
            ent_weight=0.01,
            seed=0,
            arithmetic=arithmetic,
            logger=logger,
        )
        return turn_of(algorithm, sum(int(batch["obs"].get("length").sum()) for batch in loader))

    def turn_of(algorithm: bc.BC, frames: int) -> Turn:
        def turn() -> int:
            algorithm.train(n_epochs=1, progress_bar=False)
            return frames

        return turn

    return {"stock imitation": stock(), **{agent: whole_episodes(agent) for agent in CLONED}}


def contests(level: str, size: str) -> dict[str, Callable[[], dict[str, Turn]]]:
    """:return: what takes turns in each row, the peer first"""
    stock, recurrent = "MultiInputPolicy", "MultiInputLstmPolicy"
    return {
        "levels, steps": lambda: levels(level),
        "PPO, steps": lambda: training(PPO, stock, level),
        "A2C, steps": lambda: training(A2C, stock, level),
        "RecurrentPPO, steps": lambda: training(RecurrentPPO, recurrent, level),
        "PPO's predict, calls": lambda: predicting(PPO, stock, level),
        "RecurrentPPO's predict, calls": lambda: predicting(RecurrentPPO, recurrent, level),
        "cloning, batches of 256, frames": lambda: cloning(level, size, 256),
        "cloning, batches of 32, frames": lambda: cloning(level, size, 32),
        "cloning, batches of 256, always bfloat16, frames": lambda: cloning(level, size, 256, "bfloat16"),
    }


def demonstrations_of(level: str) -> Path:
    """:return: file of its expert's episodes, made where there is none"""
    file = PLACE / f"{level}.safetensors"
    if not file.exists():
        record_demonstrations(level, expert_folder(level), "train", EPISODES, file, threads=1)
    return file


def speed(turn: Turn) -> float:
    """:return: work a second of CPU time"""
    start = time.process_time()
    done = turn()
    return done / (time.process_time() - start)


def gigaflops() -> float:
    """:return: GFLOP/s of multiplying square matrices of 32 bits, the best of ten"""
    matrix = th.randn(1024, 1024)

    def turn() -> int:
        matrix @ matrix
        return 2 * 1024**3

    return max(speed(turn) for _ in range(10)) / 1e9


def measure(level: str, size: str, turns: int, only: str) -> dict[str, Any]:
    """:return: a row for each of ours, and what this process takes the processor for"""
    th.set_num_threads(1)
    rows: list[dict[str, Any]] = []
    for name, build in tqdm(contests(level, size).items(), disable=None):
        if only not in name:
            continue
        peer, *agents = contest = build()
        speeds = np.array([[speed(turn) for turn in contest.values()] for _ in range(turns + 1)])[1:]  # the first warms up
        for agent, of_agent in zip(agents, speeds.T[1:], strict=True):
            low, times, high = np.quantile(of_agent / speeds[:, 0], [0.25, 0.5, 0.75])
            rows.append(
                {
                    "what": name,
                    "agent": agent,
                    "peer": peer,
                    "peer_per_second": round(np.median(speeds[:, 0])),
                    "per_second": round(np.median(of_agent)),
                    "times": round(times, 3),
                    "quartiles": [round(low, 3), round(high, 3)],
                }
            )
    return {"capability": th.backends.cpu.get_cpu_capability(), "matmul_gigaflops": round(gigaflops()), "rows": rows}


def table(kinds: dict[str, dict[str, Any]]) -> str:
    """:return: Markdown, a row for each of ours"""
    names = [f"{part}, {kind}" for kind in kinds for part in ("peer's", "ours", "times (goal)")]
    lines = [f"| what | ours | peer | {' | '.join(names)} |", "|---" * (3 + len(names)) + "|"]
    for alike in zip(*(kind["rows"] for kind in kinds.values()), strict=True):
        first = alike[0]
        cells = [first["what"], first["agent"], first["peer"]]
        for place, row in enumerate(alike):
            goals = GOALS.get((row["what"], row["agent"]))
            goal = f" ({goals[place]:g})" if goals else ""
            cells += [f"{row['peer_per_second']:,}", f"{row['per_second']:,}", f"{row['times']:.2f}{goal}"]
        lines.append(f"| {' | '.join(cells)} |")
    matrices = [cell for kind in kinds.values() for cell in ("", f"{kind['matmul_gigaflops']}", "")]
    return "\n".join([*lines, f"| products of matrices of 32 bits, GFLOP/s | | | {' | '.join(matrices)} |"])


def main(
    out: Annotated[Path, typer.Option(help="JSON file for the results.")],
    level: Annotated[str, typer.Option(help="Where everything is measured.")] = "GoToLocal",
    size: Annotated[str, typer.Option(help="Of the agents that are cloned.")] = "compact",
    turns: Annotated[int, typer.Option(help="Of each, after one to warm up.")] = 5,
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
