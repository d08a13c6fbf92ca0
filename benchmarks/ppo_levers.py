"""
What each setting of the experts' PPO gives: `python -m benchmarks.ppo_levers --seeds 2 --out levers.json`.

Trains with the level's settings in zoo_configs/, and with one of them changed at a time, for the same number of
frames, and tells the success rate at the end, as trained (sampled actions), and the frames per second.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from sb3_guide.callbacks.success import EpisodeSuccesses
from sb3_guide.experiments.stages.configs import load_config
from sb3_guide.experiments.stages.expert import ALGORITHMS, build
from sb3_guide.experiments.stages.runs import use_threads
from sb3_guide.files import write_json
from sb3_guide.policies.folder import package_versions

VARIANTS: dict[str, dict[str, Any]] = {
    "as shipped": {},
    "no history": {"env_kwargs": {"history": 0}},
    "history 1": {"env_kwargs": {"history": 1}},
    "history 7": {"env_kwargs": {"history": 7}},
    "learning rate 5e-4": {"learning_rate": 5e-4},
    "learning rate 2e-3": {"learning_rate": 2e-3},
    "target KL 0.03": {"target_kl": 0.03},
    "GAE lambda 0.99": {"gae_lambda": 0.99},
    "2 epochs": {"n_epochs": 2},
    "2 minibatches": {"batch_size": 1280},
    "8 minibatches": {"batch_size": 320},
    "20 steps": {"n_steps": 20, "batch_size": 320},
    "80 steps": {"n_steps": 80, "batch_size": 1280},
    "256 worlds x 10 steps": {"n_envs": 256, "n_steps": 10},
    "entropy 0.001": {"ent_coef": 0.001},
    "value loss 0.25": {"vf_coef": 0.25},
}


class AllSuccesses(EpisodeSuccesses):
    """Remembers the episodes of the last part of a training."""

    @property
    def n_episodes(self) -> int:
        return 5000


def train(algo: str, level: str, variant: dict[str, Any], seed: int, frames: int) -> dict[str, float]:
    """:return: success rate over the last tenth of the frames, and frames per second"""
    model = build(ALGORITHMS[algo], level, seed, {**load_config(algo, level), **variant})
    watcher = AllSuccesses()
    start = time.perf_counter()
    model.learn(frames * 9 // 10, callback=watcher)
    watcher.successes.clear()
    model.learn(frames // 10, callback=watcher, reset_num_timesteps=False)
    return {
        "success_rate": float(np.mean(watcher.successes)),
        "frames_per_second": model.num_timesteps / (time.perf_counter() - start),
    }


def main() -> None:
    """Train every variant with every seed, and print a row of a table for each variant."""
    parser = argparse.ArgumentParser(description="Train with one setting changed at a time.")
    parser.add_argument("--algo", choices=ALGORITHMS, default="ppo", help="algorithm, as rl-zoo names it")
    parser.add_argument("--level", default="GoToLocal", help="name of the level")
    parser.add_argument("--frames", type=int, default=300_000, help="of each training")
    parser.add_argument("--seeds", type=int, default=2, help="trainings of each variant")
    parser.add_argument("--variants", nargs="+", choices=list(VARIANTS), default=list(VARIANTS), help="what to train")
    parser.add_argument("--out", type=Path, help="JSON file for the results")
    arguments = parser.parse_args()
    use_threads(1)
    rows: dict[str, list[dict[str, float]]] = {}
    for name in arguments.variants:
        seeds = tqdm(range(arguments.seeds), desc=name)
        rows[name] = [train(arguments.algo, arguments.level, VARIANTS[name], seed, arguments.frames) for seed in seeds]
        rates = ", ".join(f"{row['success_rate']:.3f}" for row in rows[name])
        speed = np.mean([row["frames_per_second"] for row in rows[name]])
        print(f"| {name} | {rates} | {speed:,.0f} |", flush=True)
        if arguments.out:
            settings = {
                "algo": arguments.algo,
                "level": arguments.level,
                "frames": arguments.frames,
                "versions": package_versions(),
            }
            write_json(arguments.out, {**settings, "variants": rows})


if __name__ == "__main__":
    main()
