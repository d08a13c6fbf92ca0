"""
How well the shipped experts play, beside Minigrid's bot on the same missions: `python -m benchmarks.experts`.

Writes evaluation.json and the model card, README.md, into each expert's folder, and a table of all to standard output.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from sb3_guide import experts
from sb3_guide.cloning import mission_seeds, play
from sb3_guide.envs import bot
from sb3_guide.experiments.statistics import wilson_interval
from sb3_guide.policies import load_agent
from sb3_guide.policies.folder import AGENT, package_versions, read_json, write_json

CARD = """# Expert for {level}

`sb3_guide.load_expert("{level}")`: a `{policy}` (window of {history} images before the present one) trained by SB3's PPO.

| | |
|---|---|
| success, greedy, on {episodes} fresh missions | {success_rate:.1%} (95 % Wilson interval {low:.1%} to {high:.1%}) |
| mean episode length | {mean_length:.1f} (Minigrid's bot on the same missions: {bot_length:.1f}, success {bot_success:.1%}) |
| seed | {seed} |
| frames | {frames:,} |
| wall time | {minutes:.0f} minutes, {threads} thread(s){beside} |
| starts from | {init} |
| command | `{command}` |
| settings | `{config}` |
| versions | {versions} |

Trained on missions whose seeds are below 1,000,000,000; evaluated on those from {first_seed:,} on
(`python -m benchmarks.experts --levels {level}`, with {evaluated}). The weights (`network.safetensors`, `agent.json`) hold no
code. Trained for this level only: elsewhere it is a start for further training, no more.
"""


def of_bot(level: str, seeds: np.ndarray) -> tuple[float, float]:
    """:return: success rate and mean length of the bot's episodes on these missions"""
    episodes = [bot.play(level, int(seed)) for seed in tqdm(seeds, desc=f"bot {level}", unit="mission")]
    return float(np.mean([e.success for e in episodes])), float(np.mean([len(e.actions) for e in episodes]))


def evaluate(folder: Path, n_episodes: int) -> dict[str, Any]:
    """:return: how well the expert in this folder and the bot play, greedily, the same missions"""
    level, seeds = folder.name, mission_seeds("analysis", n_episodes)
    episodes = play(load_agent(folder), level, seeds)
    successes = int(episodes.successes.sum())
    low, high = wilson_interval(successes, n_episodes)
    bot_success, bot_length = of_bot(level, seeds)
    return {
        "level": level,
        "episodes": n_episodes,
        "first_seed": int(seeds[0]),
        "success_rate": successes / n_episodes,
        "low": low,
        "high": high,
        "mean_length": float(episodes.lengths.mean()),
        "bot_success": bot_success,
        "bot_length": bot_length,
        "evaluated": ", ".join(f"{name} {version}" for name, version in package_versions().items()),
    }


def card(folder: Path, evaluation: dict[str, Any]) -> str:
    """:return: the model card of the expert in this folder"""
    run, agent = read_json(folder / "run.json"), read_json(folder / AGENT)
    return CARD.format(
        **evaluation,
        policy=agent["policy"],
        history=agent["history"],
        seed=run["seed"],
        frames=run["frames"],
        minutes=run["seconds"] / 60,
        threads=run["threads"],
        beside=run.get("beside", ""),
        init="fresh weights" if run["init"] is None else f"the expert for {run['init']}",
        command=run["command"],
        config=json.dumps(run["config"]),
        versions=", ".join(f"{name} {version}" for name, version in run["versions"].items()),
    )


def main() -> None:
    """Evaluate what is asked for, write it down and print a row for each."""
    parser = argparse.ArgumentParser(description="Evaluate the shipped experts and write their model cards.")
    shipped = sorted(path.parent.name for path in experts.FOLDER.glob(f"*/{AGENT}"))
    parser.add_argument("--levels", nargs="+", choices=shipped, default=shipped, help="whose experts to evaluate")
    parser.add_argument("--episodes", type=int, default=1000, help="missions for each")
    arguments = parser.parse_args()
    for level in arguments.levels:
        folder = experts.FOLDER / level
        found = evaluate(folder, arguments.episodes)
        write_json(folder / "evaluation.json", found)
        (folder / "README.md").write_text(card(folder, found))
        print(
            f"| {level} | {found['success_rate']:.1%} ({found['low']:.1%} to {found['high']:.1%}) "
            f"| {found['mean_length']:.1f} | {found['bot_success']:.1%} | {found['bot_length']:.1f} |"
        )


if __name__ == "__main__":
    main()
