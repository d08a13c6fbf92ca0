"""
What the study of section 4.1 would take at the paper's size: its demonstrations and epochs (Table A.2, figure 4), ten seeds.

    python -m benchmarks.grid_cost --speed docs/results/speed.json

Takes the measured frames/s of one core for each agent; validations come on top. A chain, of a Guide and a guided Learner, is
what no number of cores makes shorter.
"""

from pathlib import Path
from typing import Annotated

import typer

from benchmarks.speed import GUIDE, GUIDED, LEARNER
from sb3_guide.files import read_json

LEVELS = {  # demonstrations, frames in each, epochs
    "GoToObj": (1_000, 5.1, 20),
    "GoToLocal": (50_000, 5.0, 25),
    "GoToObjMaze": (25_000, 70.8, 8),
    "PickupLoc": (100_000, 6.1, 25),
    "PutNextLocal": (100_000, 13.2, 25),
    "GoTo": (100_000, 56.8, 25),
}
RUNS = {LEARNER: 2, GUIDE: 2, GUIDED: 6}  # runs of the study by the agent whose speed they have
SEEDS = 10
CORES = (1, 16, 128)


def main(
    speed: Annotated[Path, typer.Option(help="Result of benchmarks.speed.")],
    kind: Annotated[str, typer.Option(help="Of instructions: all, or AVX2.")] = "all",
) -> None:
    """Print the table."""
    rows = read_json(speed)["kinds"][kind]["rows"]
    rates = {row["agent"]: row["per_second"] for row in rows if row["what"] == "cloning, batches of 256, frames"}
    print(
        "| level | frames a run | core hours |", " | ".join(f"days on {cores} core{'s' * (cores > 1)}" for cores in CORES), "|"
    )
    print("|---|---|---|" + "---|" * len(CORES))
    for level, (episodes, length, epochs) in LEVELS.items():
        frames = episodes * length * epochs
        seconds = {agent: frames / rates[agent] for agent in RUNS}
        total = SEEDS * sum(runs * seconds[agent] for agent, runs in RUNS.items())
        chain = seconds[GUIDE] + seconds[GUIDED]
        days = (max(total / cores, chain) / 86_400 for cores in CORES)
        print(f"| {level} | {frames / 1e6:.1f} M | {total / 3600:,.1f} |", " | ".join(f"{day:.2f}" for day in days), "|")


if __name__ == "__main__":
    typer.run(main)
