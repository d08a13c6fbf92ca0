"""
How fast whole episodes are cloned: our three agents beside stock imitation, which clones single frames with window memory.

    sb3-guide record --level GoToLocal --expert pretrained --split train --episodes 2000 --out runs/bc_speed/train.safetensors
    python -m benchmarks.bc_speed --demos runs/bc_speed/train.safetensors --out docs/results/bc_speed.json

Each is a process of its own with one thread: an epoch to warm up, in which the arithmetic of all products and convolutions is
counted, forward and backward, then one that is timed. Prints frames per second of CPU time, the ratio to stock imitation, the
peak of memory, and how many GFLOP/s that arithmetic makes, beside those of a product of square matrices of 32 bits in the same
process. Products of 16 bits may make four times as many.
"""

import math
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch as th
import typer
from gymnasium import spaces
from imitation.algorithms import bc
from imitation.data.types import DictObs
from imitation.util.logger import HierarchicalLogger
from stable_baselines3.common.logger import Logger
from torch.utils.flop_counter import FlopCounterMode

from benchmarks.versions import versions
from sb3_guide.cloning import load_demonstrations
from sb3_guide.cloning.bc import episode_bc
from sb3_guide.cloning.demonstrations import Demonstrations
from sb3_guide.envs import ACTIONS, DEFAULT_HISTORY, observation_space
from sb3_guide.experiments.stages.runs import use_threads
from sb3_guide.files import read_json, write_json
from sb3_guide.policies import (
    AgentPolicy,
    LearnerPolicy,
    PretrainedGuide,
    RecurrentGuidedLearnerPolicy,
    RecurrentGuidePolicy,
    RecurrentLearnerPolicy,
)

STOCK, FRAMES = "stock imitation", 2048  # in a batch of transitions
AGENTS: dict[str, type[AgentPolicy]] = {
    STOCK: LearnerPolicy,
    "learner": RecurrentLearnerPolicy,
    "guide": RecurrentGuidePolicy,
    "guided": RecurrentGuidedLearnerPolicy,
}
SETTINGS: dict[str, Any] = {"custom_logger": HierarchicalLogger(Logger(folder=None, output_formats=[]))}


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


def trainer(agent: str, size: str, demonstrations: Demonstrations, batch_size: int) -> tuple[Callable[[], None], int]:
    """:return: what trains an epoch, and how many frames that has"""
    kwargs = {"guide": PretrainedGuide.untrained(size=size)} if agent == "guided" else {}
    space = observation_space(DEFAULT_HISTORY if agent == STOCK else 0)
    policy = AGENTS[agent](space, spaces.Discrete(len(ACTIONS)), lambda _: 1e-3, ortho_init=False, size=size, **kwargs)
    if agent == STOCK:
        batches = transitions(demonstrations)
        algorithm = bc.BC(
            observation_space=space,
            action_space=policy.action_space,
            rng=np.random.default_rng(0),
            policy=policy,
            demonstrations=batches,
            batch_size=FRAMES,
            **SETTINGS,
        )
        frames = len(batches) * FRAMES
    else:
        settings = {"batch_size": batch_size, "learning_rate": 1e-3, "ent_weight": 0.01, "seed": 0}
        algorithm, loader = episode_bc(policy, demonstrations, logger=SETTINGS["custom_logger"], **settings)
        frames = sum(int(batch["obs"].get("length").sum()) for batch in loader)
    return lambda: algorithm.train(n_epochs=1, progress_bar=False), frames


def lstm_layer(sequences: Sequence[int], input_weight: Sequence[int], weight: Sequence[int], *_: Any, **__: Any) -> int:
    """:return: the operations of torch's own LSTM, which its counter does not know, for (B, T, in) sequences"""
    return 2 * math.prod(sequences[:2]) * (math.prod(input_weight) + math.prod(weight))


def lstm_layer_backward(*shapes: Any, **_: Any) -> int:
    """:return: of its gradients"""
    return 2 * lstm_layer(*shapes)


LSTM = {th.ops.aten.mkldnn_rnn_layer: lstm_layer, th.ops.aten.mkldnn_rnn_layer_backward: lstm_layer_backward}


def peak_gigaflops() -> float:
    """:return: GFLOP/s of multiplying square matrices, the best of ten"""
    matrix, times = th.randn(1024, 1024), []
    for _ in range(10):
        start = time.process_time()
        matrix @ matrix
        times.append(time.process_time() - start)
    return 2 * 1024**3 / min(times) / 1e9


def measure(agent: str, size: str, demos: Path, batch_size: int, out: Path) -> None:
    """Measure one agent in this process."""
    use_threads(1)
    epoch, frames = trainer(agent, size, load_demonstrations(demos), batch_size)
    with FlopCounterMode(display=False, custom_mapping=LSTM) as counter:
        epoch()
    start = time.process_time()
    epoch()
    seconds, peak = time.process_time() - start, peak_gigaflops()
    write_json(
        out,
        {
            "agent": agent,
            "frames_per_second": round(frames / seconds),
            "peak_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
            "megaflop_a_frame": round(counter.get_total_flops() / frames / 1e6, 2),
            "gflops": round(counter.get_total_flops() / seconds / 1e9, 1),
            "matmul_gflops": round(peak),
            "share_of_matmul": round(counter.get_total_flops() / seconds / 1e9 / peak, 3),
        },
    )


def main(
    demos: Annotated[Path, typer.Option(help="File of demonstrations.")],
    out: Annotated[Path, typer.Option(help="JSON file for the result.")],
    batch_size: Annotated[int, typer.Option(help="Episodes in a batch.")] = 32,
    size: Annotated[str, typer.Option(help="Of the agents.")] = "compact",
    agent: Annotated[str, typer.Option(help="Measure this one only, in this process.")] = "",
) -> None:
    """Measure every agent and print the table."""
    if agent:
        measure(agent, size, demos, batch_size, out)
        return
    rows = []
    print(
        "| agent | frames/s | times stock imitation | peak memory, MB | GFLOP/s | matmul, GFLOP/s | share |\n"
        + "|---" * 7
        + "|"
    )
    for name in AGENTS:
        options = ["--demos", str(demos), "--out", str(out), "--batch-size", str(batch_size), "--size", size, "--agent", name]
        subprocess.run([sys.executable, "-m", "benchmarks.bc_speed", *options], check=True)
        row = read_json(out)
        rows.append({**row, "ratio": round(row["frames_per_second"] / (rows or [row])[0]["frames_per_second"], 2)})
        print(
            f"| {name} | {row['frames_per_second']:,} | {rows[-1]['ratio']:.2f} | {row['peak_mb']:,} | {row['gflops']} "
            f"| {row['matmul_gflops']} | {row['share_of_matmul']:.0%} |",
            flush=True,
        )
    write_json(out, {"demos": str(demos), "batch_size": batch_size, "size": size, "agents": rows, "versions": versions()})


if __name__ == "__main__":
    typer.run(main)
