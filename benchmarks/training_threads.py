"""
What more threads of torch give to the experts' training: `python -m benchmarks.training_threads`, nothing else running.

RecurrentPPO with the recipes of zoo_configs/ppo_lstm.yml and the weights of the shipped experts, whose episodes have their
usual length. One thread and more take turns in one run.
"""

from __future__ import annotations

import argparse

import numpy as np
import torch as th

from benchmarks.ppo_speed import measure
from sb3_guide.experiments.stages.configs import load_config
from sb3_guide.experiments.stages.expert import ALGORITHMS, build
from sb3_guide.experts import expert_folder
from sb3_guide.policies import load_agent
from sb3_guide.policies.agents import LearnerAgent
from sb3_guide.policies.saving import load_weights, weights_of


def frames_per_second(level: str, threads: int, rollouts: int) -> float:
    """:return: of collecting and training"""
    th.set_num_threads(threads)
    model = build(ALGORITHMS["ppo_lstm"], level, 0, load_config("ppo_lstm", level))
    load_weights(model.policy, weights_of(load_agent(expert_folder(level), LearnerAgent)))
    return measure(model, rollouts)["frames_per_second"]


def main() -> None:
    """Print a row of a table for each level."""
    parser = argparse.ArgumentParser(description="Time the recipes' training with one and with more threads.")
    parser.add_argument("--levels", nargs="+", default=["GoToLocal", "PutNextLocal", "GoToObjMaze"], help="names")
    parser.add_argument("--threads", type=int, default=2, help="beside one")
    parser.add_argument("--rollouts", type=int, default=4, help="of each turn")
    parser.add_argument("--turns", type=int, default=3, help="of each number of threads")
    arguments = parser.parse_args()
    for level in arguments.levels:
        turns = [
            [frames_per_second(level, threads, arguments.rollouts) for threads in (1, arguments.threads)]
            for _ in range(arguments.turns)
        ]
        one, more = np.median(turns, axis=0)
        print(f"| {level} | {one:,.0f} | {more:,.0f} | {more / one:.2f} |", flush=True)


if __name__ == "__main__":
    main()
