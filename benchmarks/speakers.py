"""
Ship agents with a channel: halve their weights to 16 bits, measure what is left, learn their words, write their cards.

    for level in GoToObj GoToLocal PickupLoc PutNextLocal; do
      python -m benchmarks.speakers --level $level --runs runs/speakers/$level
    done

A folder of --runs holds the agents "guide" and "guided", as sb3-guide clone makes them, and "expert" if their demonstrations
are not of the shipped one; the cards say how.
"""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from sb3_guide.cloning import mission_seeds
from sb3_guide.envs import ACTIONS
from sb3_guide.experiments.stages.evaluate import evaluate
from sb3_guide.experiments.stages.runs import use_threads
from sb3_guide.experiments.stages.speak import entries
from sb3_guide.files import read_json, write_json, write_text
from sb3_guide.language import Dictionary, obey, overhear, save_dictionary
from sb3_guide.metrics import obedience
from sb3_guide.policies import AgentPolicy, load_agent
from sb3_guide.policies.folder import read_agent, write_agent
from sb3_guide.speakers import DICTIONARY, FOLDER

EVALUATED = ("episodes", "successes", "success_rate", "low", "high", "mean_length", "first_seed", "versions")
PARAMS = ("train_episodes", "n_epochs", "validate_every", "batch_size", "learning_rate")  # that differ from zoo_configs/bc.yml
AGENTS = {"guide": "A Guide of", "guided": "A Learner that hears a Guide of"}


def ship(level: str, runs: Path, agent: str) -> None:
    """Write the folder of an agent."""
    folder = FOLDER / level / agent
    description, weights = read_agent(runs / agent)
    write_agent(folder, description, {name: weight.half() for name, weight in weights.items()})
    evaluate(folder, level, 1000, folder / "evaluation.json", threads=1)
    found = read_json(folder / "evaluation.json")
    write_json(folder / "evaluation.json", {name: found[name] for name in EVALUATED})
    policy = load_agent(folder)
    dictionary = overhear(policy, level, mission_seeds("validation", 500))
    save_dictionary(dictionary, folder / DICTIONARY)
    made_by = commands(level, agent, read_json(runs / agent / "run.json"), (runs / "expert").is_dir())
    write_text(folder / "README.md", card(level, agent, policy, dictionary, made_by, found))


def commands(level: str, agent: str, run: dict[str, Any], own_expert: bool) -> list[str]:
    """:return: lines of the shell that make the agent"""
    folder, config = f"runs/speakers/{level}", run["config"]
    expert = f"{folder}/expert" if own_expert else "pretrained"
    guide = f" --guide {folder}/guide" if agent == "guided" else ""
    params = " ".join(f"--params {name}:{config[name]}" for name in PARAMS)
    return [
        *([f"sb3-guide expert --level {level} --out {expert}"] if own_expert else []),
        f"for split in train:{config['train_episodes']} validation:500; do",
        f"  sb3-guide record --level {level} --expert {expert} --split ${{split%:*}} --episodes ${{split#*:}} \\",
        f"    --out {folder}/demos/${{split%:*}}.safetensors",
        "done",
        f"sb3-guide clone --agent {agent} --level {level} --demos {folder}/demos{guide} \\",
        f"  --seed {run['seed']} {params} \\",
        f"  --out {folder}/{agent}",
    ]


def card(
    level: str, agent: str, policy: AgentPolicy, dictionary: Dictionary, made_by: list[str], found: dict[str, Any]
) -> str:
    """:return: the model card"""
    meant, taken = obey(policy, level, dictionary, mission_seeds("analysis", 50), np.random.default_rng(0))
    raw, corrected = obedience(meant, taken)
    by_action = ", ".join(f"{ACTIONS[a]} {(taken[meant == a] == a).mean():.0%}" for a in np.unique(meant))
    beyond = "all of them mean the same" if np.isnan(corrected) else f"{corrected:.0%} beyond chance"
    words = [
        f"| {entry['message']} | {entry['action']} | {entry['probability']:.0%} | {entry['frames']:,} |"
        for entry in entries(dictionary)
    ]
    return "\n".join(
        [
            f"# {AGENTS[agent]} {level}",
            "",
            f"Solves {found['success_rate']:.1%} of 1,000 fresh missions greedily (95 % interval {found['low']:.1%} to "
            f"{found['high']:.1%}). Weights are stored with 16 bits.",
            "",
            f"Told 500 random messages that mean something, it obeys {raw:.0%} ({beyond}): {by_action}.",
            "",
            "| message | action that mostly follows | how often | frames of 500 episodes |",
            "|---|---|---|---|",
            *words,
            "",
            "Made by",
            "",
            "```sh",
            *made_by,
            "```",
            "",
        ]
    )


def main(level: Annotated[str, typer.Option()], runs: Annotated[Path, typer.Option()]) -> None:
    """Ship both agents of a level."""
    use_threads(1)
    for agent in AGENTS:
        ship(level, runs, agent)


if __name__ == "__main__":
    typer.run(main)
