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
from stable_baselines3.common.utils import set_random_seed
from tqdm import tqdm

from sb3_guide import experts
from sb3_guide.cloning import mission_seeds, play
from sb3_guide.envs import bot
from sb3_guide.experiments.stages.expert import ALGORITHMS
from sb3_guide.experiments.stages.statistics import wilson_interval
from sb3_guide.files import read_json, write_json
from sb3_guide.policies import AgentPolicy, load_agent
from sb3_guide.policies.folder import AGENT, package_versions

CARD = """# Expert for {level}

`sb3_guide.load_expert("{level}")`: a `{policy}`, trained by {algorithm} {memory}.

| | |
|---|---|
| success on {episodes} fresh missions, actions drawn as in training | {sampled} |
| success on the same missions, greedy | {greedy} |
| mean episode length, drawn and greedy | {sampled_length:.1f} and {greedy_length:.1f} |
| Minigrid's bot on the same missions | success {bot_success:.1%}, mean length {bot_length:.1f} |
| seed | {seed} |
| commands, in this order | {commands} |
| frames | {frames} |
| wall time | {minutes} minutes on {threads} core, beside other jobs |
| settings of the last | `{config}` |
| versions | {versions} |

Trained on missions whose seeds are below 1,000,000,000; evaluated on those from {first_seed:,} on
(`python -m benchmarks.experts --levels {level}`). `runs.json` has the settings of each command, also where the file that
it names is no more. The weights (`network.safetensors`, `agent.json`) hold no code. Trained for this level only: elsewhere
it is a start for further training, no more.
"""

MEMORY = {
    "ppo": "with a window of the {history} images before the present one",
    "ppo_lstm": "with a memory that is carried through the episode",
}


def of_bot(level: str, seeds: np.ndarray) -> tuple[float, float]:
    """:return: success rate and mean length of the bot's episodes on these missions"""
    episodes = [bot.play(level, int(seed)) for seed in tqdm(seeds, desc=f"bot {level}", unit="mission")]
    return float(np.mean([e.success for e in episodes])), float(np.mean([len(e.actions) for e in episodes]))


def of_expert(policy: AgentPolicy, level: str, seeds: np.ndarray, deterministic: bool) -> dict[str, float]:
    """:return: success rate with its interval, and mean length, of the expert's episodes on these missions"""
    set_random_seed(0)
    episodes = play(policy, level, seeds, deterministic=deterministic)
    successes = int(episodes.successes.sum())
    low, high = wilson_interval(successes, len(seeds))
    length = float(episodes.lengths.mean())
    return {"success_rate": successes / len(seeds), "low": low, "high": high, "mean_length": length}


def evaluate(folder: Path, n_episodes: int) -> dict[str, Any]:
    """:return: how well the expert in this folder and the bot play the same missions"""
    level, policy, seeds = folder.name, load_agent(folder), mission_seeds("analysis", n_episodes)
    bot_success, bot_length = of_bot(level, seeds)
    return {
        "level": level,
        "episodes": n_episodes,
        "first_seed": int(seeds[0]),
        "sampled": of_expert(policy, level, seeds, deterministic=False),
        "greedy": of_expert(policy, level, seeds, deterministic=True),
        "bot_success": bot_success,
        "bot_length": bot_length,
        "versions": package_versions(),
    }


def in_words(found: dict[str, float]) -> str:
    """:return: success rate with its interval"""
    return f"{found['success_rate']:.1%} (95 % Wilson interval {found['low']:.1%} to {found['high']:.1%})"


def card(folder: Path, evaluation: dict[str, Any]) -> str:
    """:return: the model card of the expert in this folder"""
    runs, agent = read_json(folder / "runs.json", list), read_json(folder / AGENT)
    last = runs[-1]
    return CARD.format(
        level=evaluation["level"],
        episodes=evaluation["episodes"],
        first_seed=evaluation["first_seed"],
        sampled=in_words(evaluation["sampled"]),
        greedy=in_words(evaluation["greedy"]),
        sampled_length=evaluation["sampled"]["mean_length"],
        greedy_length=evaluation["greedy"]["mean_length"],
        bot_success=evaluation["bot_success"],
        bot_length=evaluation["bot_length"],
        policy=agent["policy"],
        algorithm=ALGORITHMS[last["algo"]].__name__,
        memory=MEMORY[last["algo"]].format(history=agent["history"]),
        seed=last["seed"],
        commands=", ".join(f"`{run['command']}`" for run in runs),
        frames=" + ".join(f"{run['frames']:,}" for run in runs),
        minutes=" + ".join(f"{run['seconds'] / 60:.1f}" for run in runs),
        threads=last["threads"],
        config=json.dumps(last["config"]),
        versions=", ".join(f"{name} {version}" for name, version in last["versions"].items()),
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
        sampled, greedy = found["sampled"], found["greedy"]
        print(
            f"| {level} | {in_words(sampled)} | {sampled['mean_length']:.1f} | {greedy['success_rate']:.1%} "
            f"| {found['bot_success']:.1%} | {found['bot_length']:.1f} |"
        )


if __name__ == "__main__":
    main()
