"""
How fast agents learn from reward by how their weights begin: `python -m benchmarks.initialisation --out runs/initialisation`.

Trains on the level itself, without a curriculum, with the settings that the zoo_configs have for GoToObj, until 99 % of
the last 1,000 episodes succeeded or the cap of frames is reached. Writes curves.csv and finals.csv after each training and
prints a table of all. What is in finals.csv is not run again; with --seeds 0, nothing is.
"""

from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from torch import nn

from benchmarks.rl_guidance import EPISODES_OF, Curve, reached, spread
from sb3_guide.experiments.stages.configs import load_config
from sb3_guide.experiments.stages.expert import ALGORITHMS, build
from sb3_guide.experiments.stages.runs import read_table, use_threads, write_table

KEY = ["algo", "policy", "level", "start", "seed"]
STARTS = {
    "orthogonal": "SB3's orthogonal initialisation (`ortho_init: true`)",
    "own": "the networks' own (the default)",
    "small head": "the networks' own, the action head at 0.01 of SB3's size",
}


def model_of(algo: str, policy: str, level: str, start: str, seed: int) -> OnPolicyAlgorithm:
    """:return: not yet trained; seeds are far enough apart that their worlds differ"""
    config = load_config(algo, "GoToObj")  # the same settings on all levels
    kwargs = {**config.get("policy_kwargs", {}), "ortho_init": start == "orthogonal"}
    model = build(ALGORITHMS[algo], level, 1000 * seed, {**config, "policy": policy, "policy_kwargs": kwargs})
    if start == "small head":
        nn.init.orthogonal_(model.policy.action_net.weight, gain=0.01)
        nn.init.zeros_(model.policy.action_net.bias)
    return model


def run(key: dict[str, Any], frames: int) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """:return: rows of the curve, and of the end"""
    model, curve = model_of(**key), Curve()
    model.learn(frames, callback=curve)
    last = curve.rows[-1]
    ends = {name: last.get(name) for name in ("frames", "cpu_seconds", "success_1000")}
    return [key | row for row in curve.rows], key | ends | {"cap": frames} | reached(curve.rows)


def key_of(row: dict[str, Any]) -> tuple[str, ...]:
    """:return: which training a row is of"""
    return tuple(str(row[name]) for name in KEY)


def add(path: Path, rows: list[dict[str, Any]]) -> None:
    """Append the rows of a training to a CSV file."""
    write_table(path, [*(read_table(path) if path.is_file() else []), *rows])


def table(finals: pd.DataFrame) -> list[str]:
    """:return: lines of Markdown, one for each way to begin"""
    lines = ["| algorithm | policy | level | cap | start | seeds | frames to 50 % | to 90 % | to 99 % | at the end |"]
    lines.append("|---" * 10 + "|")
    for (algo, policy, level, cap), group in finals.groupby(["algo", "policy", "level", "cap"], sort=False):
        for start in STARTS:
            runs = group[group["start"] == start].sort_values("seed")
            if len(runs):
                took = [spread(runs[f"frames_to_{percent}"]) for percent in EPISODES_OF]
                ends = ", ".join(f"{rate:.1%}" for rate in runs["success_1000"])
                cells = [ALGORITHMS[algo].__name__, policy, level, f"{cap:,}", start, str(len(runs)), *took, ends]
                lines.append(f"| {' | '.join(cells)} |")
    return lines


def main(
    out: Annotated[Path, typer.Option(help="Folder of the tables.")],
    level: Annotated[str, typer.Option(help="Where to train.")] = "GoToLocal",
    algo: Annotated[str, typer.Option(help="ppo_lstm or ppo.")] = "ppo_lstm",
    policy: Annotated[str, typer.Option(help="LearnerPolicy or GuidePolicy.")] = "LearnerPolicy",
    starts: Annotated[list[str] | None, typer.Option(help="Ways to begin; all if left out.")] = None,
    seeds: Annotated[int, typer.Option(help="How many, from 0 on.")] = 3,
    frames: Annotated[int, typer.Option(help="At most.")] = 330_000,
) -> None:
    """Run what is missing, all starts of a seed one after the other, and print the table."""
    use_threads(1)
    if seeds:  # the engine is compiled once on a machine, which counts for no run
        model_of(algo, policy, level, "own", 0).learn(1)
    out.mkdir(parents=True, exist_ok=True)
    finals = out / "finals.csv"
    for seed in range(seeds):
        for start in starts or STARTS:
            key = {"algo": algo, "policy": policy, "level": level, "start": start, "seed": seed}
            if not (finals.is_file() and key_of(key) in map(key_of, read_table(finals))):
                curve, end = run(key, frames)
                add(out / "curves.csv", curve)
                add(finals, [end])
                print(end, flush=True)
    print("\n".join(table(pd.read_csv(finals))))


if __name__ == "__main__":
    typer.run(main)
