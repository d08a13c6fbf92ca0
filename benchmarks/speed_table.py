"""Print results of `benchmarks.env_speed` as a table: `python -m benchmarks.speed_table docs/results/env_speed.json`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path


def table(speeds: dict[tuple[str, str, int], float], worlds: int) -> str:
    """
    Compare ours with the others.

    :param speeds: steps per second by engine, level and number of worlds
    :param worlds: the number of worlds to show
    :return: Markdown, a row for every level
    """
    names = (f"level, {worlds:,} worlds", "ours, steps/s", "Minigrid", "EnvPool", "times Minigrid", "times EnvPool")
    lines = [f"| {' | '.join(names)} |", "|---" * len(names) + "|"]
    for level in dict.fromkeys(level for _, level, _ in speeds):
        ours, *others = (speeds.get((engine, level, worlds)) for engine in ("ours", "minigrid", "envpool"))
        if ours:
            cells = [f"{other:,.0f}" if other else "-" for other in (ours, *others)]
            cells += [f"{ours / other:,.1f}" if other else "-" for other in others]
            lines.append(f"| {level} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Print a table for every number of worlds."""
    parser = argparse.ArgumentParser(description="Print results of benchmarks.env_speed as tables.")
    parser.add_argument("results", type=Path, help="JSON file of benchmarks.env_speed")
    rows = json.loads(parser.parse_args().results.read_text())["speed"]
    speeds = {(row["engine"], row["level"], row["worlds"]): row["steps_per_second"] for row in rows}
    print("\n\n".join(table(speeds, worlds) for worlds in sorted({worlds for _, _, worlds in speeds}, reverse=True)))


if __name__ == "__main__":
    main()
