"""
Stands in for the stages' command line: writes plausible files of their formats in a fraction of a second.

Called as the stages are: `-m sb3_guide.experiments.cli expert --level L ...`, after the name of the interpreter. The
environment says what goes wrong: FAKE_FAILURE names a stage that fails, FAKE_SECONDS how long each takes.
"""

import argparse
import csv
import json
import os
import sys
import time
import zlib
from pathlib import Path

import numpy as np
from filelock import FileLock
from PIL import Image

EPOCHS = 12
ACTIONS = ["left", "right", "forward", "pickup", "drop", "toggle", "done"]
MESSAGES = [f"w{first} w{second}" for first in range(3) for second in range(3)]
VERSIONS = {"sb3-guide": "0.1.0", "stable-baselines3": "2.2.1", "torch": "2.13.0"}


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("stage")
    parser.add_argument("folder", nargs="?")
    for option in ("level", "seed", "out", "threads", "expert", "split", "episodes", "agent", "guide", "hears", "init"):
        parser.add_argument(f"--{option}")
    for option in ("demos", "params"):
        parser.add_argument(f"--{option}", action="append")
    for option in ("renew", "freeze-guide", "obedience"):
        parser.add_argument(f"--{option}", action="store_true")
    options = parser.parse_args(arguments)
    out = Path(options.out)
    out.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(f"{out}.lock"):
        pause(options)
        STAGES[options.stage](options, out)


def everything(options: argparse.Namespace, out: Path) -> None:
    """Every result of the levels in `folder`, joined by commas, and of so many seeds."""
    for level in options.folder.split(","):
        at = out / level
        call("expert", level, at / "expert")
        call("evaluate", level, at / "evaluation" / "expert.json", folder=str(at / "expert"))
        for split, episodes in (("train", 1000), ("validation", 500), ("analysis", 500)):
            call("record", level, at / "demos" / f"{split}.safetensors", split=split, episodes=episodes)
        for seed in range(int(options.seed)):
            run = at / f"seed{seed}"
            for agent in ("learner", "guide", "guided"):
                call("clone", level, run / agent, agent=agent, seed=seed)
            for agent in ("guide", "guided"):
                call("analyze", level, run / "analysis" / agent, folder=f"{level}/seed{seed}/{agent}")


def call(stage: str, level: str, out: Path, **options: object) -> None:
    out.parent.mkdir(parents=True, exist_ok=True)
    nothing = dict.fromkeys(("folder", "agent", "guide", "seed", "split", "episodes"))
    STAGES[stage](argparse.Namespace(**{**nothing, "stage": stage, "level": level, **options}), out)


def pause(options: argparse.Namespace) -> None:
    """Progress as tqdm writes it, and a checkpoint; then perhaps the failure that a test asked for."""
    for step in range(5):
        time.sleep(float(os.environ.get("FAKE_SECONDS", "0.05")) / 5)
        print(f"\r{options.stage} {options.level}: {20 * (step + 1)} %", end="", file=sys.stderr, flush=True)
    if os.environ.get("FAKE_FAILURE", "none") in (options.stage, options.agent):
        sys.exit("\nError: the demonstrations are made of cheese")


def generator(options: argparse.Namespace) -> np.random.Generator:
    text = f"{options.stage} {options.level} {options.agent} {options.seed} {options.folder} {options.split}"
    return np.random.default_rng(zlib.crc32(text.encode()))


def run_json(options: argparse.Namespace, **more: object) -> dict[str, object]:
    return {
        "stage": options.stage,
        "command": f"sb3-guide {options.stage}",
        "level": options.level,
        "seed": int(options.seed or 0),
        "config": {"n_epochs": EPOCHS, "train_episodes": 1000, "validation_episodes": 500},
        "agent": options.agent,
        "guide": f"{options.level}/seed{options.seed}/guide" if options.agent == "guided" else None,
        "freeze_guide": False,
        "hears": "spoken",
        "versions": VERSIONS,
        "seconds": round(20 + 10 * generator(options).random(), 1),
        "finished": "2026-01-01T00:00:00+00:00",
        **more,
    }


def write_json(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def write_csv(path: Path, rows: list[dict[str, object]]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def write_agent(options: argparse.Namespace, out: Path, progress: list[dict[str, object]]) -> None:
    out.mkdir(parents=True, exist_ok=True)
    (out / "network.safetensors").write_bytes(generator(options).bytes(64))
    form = {"channel": "discrete", "message_length": 2, "vocabulary_size": 3}
    kwargs = {"guide": form, "guided": {"guide": {"kwargs": form}}}.get(options.agent, {})
    write_json(out / "agent.json", {"level": options.level, "kwargs": kwargs})
    write_csv(out / "progress.csv", progress)
    write_json(out / "run.json", run_json(options))


def expert(options: argparse.Namespace, out: Path) -> None:
    steps = range(10_000, 100_001, 10_000)
    write_agent(options, out, [{"time/total_timesteps": step, "rollout/success_rate": step / 100_500} for step in steps])


def record(options: argparse.Namespace, out: Path) -> None:
    out.write_bytes(generator(options).bytes(64))
    episodes = int(options.episodes)
    numbers = {"episodes": episodes, "frames": 5 * episodes, "mean_length": 5.0, "expert_success_rate": 0.998}
    write_json(out.with_suffix(".json"), run_json(options, **numbers))


def clone(options: argparse.Namespace, out: Path) -> None:
    rng, speed = generator(options), {"learner": 0.3, "guide": 0.35, "guided": 0.6}[options.agent]
    rows: list[dict[str, object]] = []
    for epoch in (0, 0.5, *range(1, EPOCHS + 1)):
        success = float(np.clip(1 - np.exp(-speed * epoch) - 0.02 + 0.02 * rng.standard_normal(), 0, 1))
        row: dict[str, object] = {
            "epoch": epoch,
            "loss": 2 * np.exp(-speed * epoch),
            "success_rate": success,
            "mean_length": 6.0,
            "cic": "",
            "uniform_cic": "",
            "message_entropy": "",
            "episodes": int(1000 * epoch),
            "seconds": 2.0 * epoch,
        }
        if options.agent != "learner":
            fall = np.exp(-0.1 * epoch) + 0.02 * rng.random()
            row |= {"cic": 0.7 * fall, "uniform_cic": 0.9 * (1 - 0.4 * np.exp(-0.5 * epoch)), "message_entropy": 1.2 * fall}
        rows.append(row)
    write_agent(options, out, rows)
    evaluate(options, out / "evaluation.json")


def evaluate(options: argparse.Namespace, out: Path) -> None:
    successes = 500 - int(generator(options).integers(12))
    rate = successes / 500
    write_json(
        out,
        {
            "level": options.level,
            "agent": options.folder,
            "episodes": 500,
            "successes": successes,
            "success_rate": rate,
            "low": rate - 0.015,
            "high": min(1.0, rate + 0.005),
            "mean_length": 5.4,
            "first_seed": 2_000_000,
            "seconds": 3.0,
        },
    )


def analyze(options: argparse.Namespace, out: Path) -> None:
    rng = generator(options)
    counts = np.zeros((len(MESSAGES), len(ACTIONS)), int)
    for message in (0, 1, 2, 4, 5, 8):
        sharp = rng.dirichlet([0.3, 0.3, 0.6])
        counts[message, :3] = rng.multinomial(int(rng.integers(20, 900)), sharp)
    write_json(
        out / "analysis.json",
        {
            "level": options.level,
            "agent": options.folder,
            "guide": options.guide,
            "messages": MESSAGES,
            "actions": ACTIONS,
            "counts": counts.tolist(),
            "cic": 0.41,
            "uniform_cic": 0.83,
            "message_entropy": 0.62,
            "episodes": 500,
            "frames": int(counts.sum()),
            "seconds": 4.0,
        },
    )
    frames = [Image.fromarray(np.full((320, 320, 3), 40 * step, np.uint8)) for step in range(5)]
    frames[0].save(out / "episode.gif", save_all=True, append_images=frames[1:], duration=300, loop=0)


def speak(options: argparse.Namespace, out: Path) -> None:
    words = [("w0 w0", "forward", 300), ("w2 w1", "left", 100)]
    entries = [{"message": word, "action": action, "frames": frames, "means_it": True} for word, action, frames in words]
    obedience = {"messages": 500, "raw": 0.9, "corrected": 0.8, "by_action": {"forward": 1.0, "left": 0.8}}
    write_json(out / "speech.json", {"dictionary": entries, "obedience": obedience})


STAGES = {
    "everything": everything,
    "expert": expert,
    "record": record,
    "clone": clone,
    "evaluate": evaluate,
    "analyze": analyze,
    "speak": speak,
}

if __name__ == "__main__":
    arguments = sys.argv[1:]
    main(arguments[2:] if arguments[0] == "-m" else arguments)
