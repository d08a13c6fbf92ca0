"""
How long the experts' recipes take, seed by seed: `python -m benchmarks.recipes --seeds 3 --out runs/recipes`.

Runs `sb3-guide expert`, with whatever options it is given besides its own, for each level and seed, and plays fresh missions
with what comes of it. Appends a row for each to recipes.csv and its curve to recipe_curves.csv, both in the folder of tables,
draws recipes.png there and prints all rows. What is in recipes.csv is not run again; with --seeds 0, nothing is.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from benchmarks.experts import of_expert
from benchmarks.versions import processor, this_commit
from sb3_guide.cloning import mission_seeds
from sb3_guide.experiments.stages.runs import read_table, write_table
from sb3_guide.files import read_json
from sb3_guide.language.pictures import save_figure
from sb3_guide.policies import load_agent

ROOMS = ["GoToObj", "GoToLocal", "PickupLoc", "PutNextLocal"]
KEY = ["level", "seed", "instructions", "commit"]
INSTRUCTIONS: dict[str, dict[str, str]] = {  # variables that hide a processor's larger units from torch
    "AVX2": {"ONEDNN_MAX_CPU_ISA": "AVX2", "ATEN_CPU_CAPABILITY": "avx2"},
    "all": {},
}
POINTS = 60  # of a curve
WAYS = ("drawn", "greedy")
COLOURS = ("#0072b2", "#d55e00", "#007d5b", "#a3508a", "#e69f00")


def train(level: str, seed: int, folder: Path, options: list[str], variables: Mapping[str, str]) -> dict[str, float]:
    """:return: seconds that the command computed, and that it took; the expert is in the folder then"""
    wall, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    command = ["expert", "--level", level, "--seed", str(seed), "--out", str(folder), *options]
    environment = {**os.environ, **variables}
    subprocess.run([sys.executable, "-m", "sb3_guide.experiments.cli", *command], check=True, env=environment)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
    return {"cpu_seconds": round(cpu, 1), "wall_seconds": round(time.monotonic() - wall, 1)}


def measure(
    key: dict[str, Any], folder: Path, options: list[str], seeds: np.ndarray
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """:return: what the recipe took and gave on these missions, and its curve"""
    level = key["level"]
    took = train(level, key["seed"], folder, options, INSTRUCTIONS[key["instructions"]])
    policy, rows = load_agent(folder), read_table(folder / "progress.csv")
    found = {**key, "processor": processor(), "frames_until_small_steps": until_small_steps(rows)}
    found |= {"frames": read_json(folder / "run.json")["frames"], **took, "episodes": len(seeds)}
    for way in WAYS:
        played = of_expert(policy, level, seeds, deterministic=way == "greedy")
        found |= {f"{way}_{name}": round(value, 4) for name, value in played.items()}
    return found, [key | point for point in curve(rows)]


def until_small_steps(rows: list[dict[str, str]]) -> int:
    """:return: frames before the last part of the curriculum"""
    earlier = [row for row in rows if row["curriculum/part"] != rows[-1]["curriculum/part"]]
    return int(earlier[-1]["time/total_timesteps"]) if earlier else 0


def curve(rows: list[dict[str, str]]) -> list[dict[str, Any]]:
    """:return: success in training, its mean over about one in POINTS of the rollouts each"""
    table = pd.DataFrame(
        {
            "frames": [int(row["time/total_timesteps"]) for row in rows],
            "part": [int(float(row["curriculum/part"])) for row in rows],
            "success_rate": [float(row["rollout/success_rate"] or "nan") for row in rows],
        }
    )
    size = -(-len(table) // POINTS)
    ends = table.groupby(table.index // size).agg({"frames": "last", "part": "last", "success_rate": "mean"})
    return ends.round(4).dropna().to_dict("records")


def key_of(row: Mapping[str, Any]) -> tuple[str, ...]:
    """:return: which training a row is of"""
    return tuple(str(row[name]) for name in KEY)


def add(path: Path, rows: list[dict[str, Any]]) -> None:
    """Append rows to a CSV file."""
    write_table(path, [*(read_table(path) if path.is_file() else []), *rows])


def in_order(path: Path) -> pd.DataFrame:
    """:return: what a CSV file holds, easier levels first, and by seed"""
    table = pd.read_csv(path, dtype={"commit": str})
    place = table["level"].map(lambda level: ROOMS.index(level) if level in ROOMS else len(ROOMS))
    return table.assign(place=place).sort_values(["place", "seed"], kind="stable").drop(columns="place")


def lines(table: pd.DataFrame) -> list[str]:
    """:return: of Markdown, a row for each training"""
    found = [
        "| level | seed | instructions | until small steps | frames in all | CPU minutes | success, drawn | greedy | commit |"
    ]
    found.append("|---" * 9 + "|")
    for row in table.to_dict("records"):
        rates = [f"{row[f'{way}_success_rate']:.1%} ({row[f'{way}_low']:.1%} to {row[f'{way}_high']:.1%})" for way in WAYS]
        cells = [row["level"], row["seed"], row["instructions"], f"{row['frames_until_small_steps']:,}"]
        cells += [f"{row['frames']:,}", f"{row['cpu_seconds'] / 60:.1f}", *rates, row["commit"]]
        found.append(f"| {' | '.join(map(str, cells))} |")
    return [line.replace("%", " %") for line in found]


def draw(curves: pd.DataFrame) -> Figure:
    """:return: a panel for each level, a line for each seed; dots where steps become small"""
    levels = list(dict.fromkeys(curves["level"]))
    figure = Figure(figsize=(3.2 * len(levels), 3.1), layout="constrained")
    for panel, level in zip(figure.subplots(1, len(levels), sharey=True, squeeze=False)[0], levels, strict=True):
        of_level = curves[curves["level"] == level]
        for _, run in of_level.groupby(KEY, sort=False):
            seed, kind = int(run["seed"].iloc[0]), run["instructions"].iloc[0]
            style = {"color": COLOURS[seed % len(COLOURS)], "linestyle": "-" if kind == "AVX2" else ":", "linewidth": 1.2}
            label = f"seed {seed}" + ("" if kind == "AVX2" else ", all instructions")
            millions = run["frames"] / 1e6
            panel.plot(millions, run["success_rate"], label=label, **style)
            before = run["part"] < run["part"].max()
            if before.any():
                panel.plot(millions[before].iloc[-1:], run["success_rate"][before].iloc[-1:], "o", color=style["color"], ms=4)
        panel.set_title(level, fontsize=10, loc="left")
        panel.set_xlabel("million frames")
        panel.set_xlim(left=0)
        panel.xaxis.set_major_locator(MaxNLocator(4))
        panel.set_ylim(0, 1.02)
        panel.yaxis.set_major_formatter(PercentFormatter(1))
        panel.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("of the last 100 episodes solved")
    shown = {line.get_label(): line for panel in figure.axes for line in panel.get_legend_handles_labels()[0]}
    figure.legend(handles=list(shown.values()), loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    return figure


def main() -> None:
    """Run what is missing and print all."""
    parser = argparse.ArgumentParser(description="Train experts by their recipes. Other options go to sb3-guide expert.")
    parser.add_argument("--levels", nargs="+", default=ROOMS)
    parser.add_argument("--seeds", type=int, default=3, help="how many of each level")
    parser.add_argument("--first-seed", type=int, default=0, help="seeds from this one on")
    parser.add_argument("--instructions", choices=INSTRUCTIONS, default="all", help="of the processor that torch may use")
    parser.add_argument("--episodes", type=int, default=1000, help="missions to evaluate on")
    parser.add_argument(
        "--missions", choices=("analysis", "validation"), default="analysis", help="fresh ones, or to choose by"
    )
    parser.add_argument("--out", type=Path, help="folder for the experts; needed unless --seeds is 0")
    parser.add_argument("--tables", type=Path, help="folder for the tables; --out if left out")
    arguments, options = parser.parse_known_args()
    tables = arguments.tables or arguments.out
    rows, curves = tables / "recipes.csv", tables / "recipe_curves.csv"
    for level in arguments.levels:
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
            key = {"level": level, "seed": seed, "instructions": arguments.instructions, "commit": this_commit()}
            if not (rows.is_file() and key_of(key) in map(key_of, read_table(rows))):
                folder = arguments.out / f"{level}-{seed}-{arguments.instructions}"
                missions = mission_seeds(arguments.missions, arguments.episodes)
                found, points = measure(key, folder, options, missions)
                add(curves, points)
                add(rows, [found])
    print("\n".join(lines(in_order(rows))))
    save_figure(draw(in_order(curves)), tables / "recipes.png")


if __name__ == "__main__":
    main()
