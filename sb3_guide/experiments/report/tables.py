"""All finished runs of a folder in two tables, which is what results pages are made from and what is kept of a study."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sb3_guide.experiments.stages.clone import UNTRAINED
from sb3_guide.experiments.stages.runs import intact, read_table, write_table
from sb3_guide.files import read_json
from sb3_guide.policies.folder import AGENT

CURVE = ("episodes", "success_rate", "loss", "cic", "uniform_cic", "message_entropy")
FORM = ("channel", "message_length", "vocabulary_size")


def write_tables(runs: Path, out: Path) -> None:
    """
    Merge every finished run of a folder into ``curves.csv``, a row a validation, and ``finals.csv``, a row a run. Rows of
    other runs that the tables hold already stay, so that a study can be collected from several machines.

    :param runs: folder of runs, as ``sb3-guide reproduce`` makes it
    :param out: folder of the tables, made if need be
    :raises ValueError: if there is no finished run, or a result is damaged
    """
    found = sorted(finished(runs))
    if not found:
        raise ValueError(f"{runs} holds no finished run: expected a folder that sb3-guide reproduce has made")
    with intact(runs):
        curves, finals = [row for key in found for row in curve(runs, *key)], [final(runs, *key) for key in found]
    out.mkdir(parents=True, exist_ok=True)
    merge(out / "curves.csv", curves)
    merge(out / "finals.csv", finals)


def finished(runs: Path) -> Iterator[tuple[str, str, int]]:
    """:return: level, condition and seed of every run that has ended, whose run.json is written last"""
    for path in runs.glob("*/seed*/*/run.json"):
        level, seed, condition = path.parent.relative_to(runs).parts
        yield level, condition, int(seed.removeprefix("seed"))


def curve(runs: Path, level: str, condition: str, seed: int) -> list[dict[str, Any]]:
    """:return: a row for each validation of a run"""
    folder = runs / level / f"seed{seed}" / condition
    key = {"level": level, "condition": condition, "seed": seed}
    return [key | {name: short(row.get(name, "")) for name in CURVE} for row in read_table(folder / "progress.csv")]


def final(runs: Path, level: str, condition: str, seed: int) -> dict[str, Any]:
    """:return: the row of a run"""
    folder = runs / level / f"seed{seed}" / condition
    run, evaluation = read_json(folder / "run.json"), read_json(folder / "evaluation.json")
    return {
        "level": level,
        "condition": condition,
        "seed": seed,
        "agent": run["agent"],
        "train_episodes": run["config"]["train_episodes"] * len(level.split("+")),
        "n_epochs": run["config"]["n_epochs"],
        "successes": evaluation["successes"],
        "missions": evaluation["episodes"],
        "success_rate": evaluation["success_rate"],
        "mean_length": round(evaluation["mean_length"], 3),
        "seconds": run["seconds"],
        **channel(folder, run.get("guide")),
        "control": control(run, level),
        **speech(folder.parent / "speech" / condition / "speech.json"),
    }


def control(run: dict[str, Any], level: str) -> str:
    """
    :param run: of a guided Learner, or of another agent, which is no control
    :param level: of the run
    :return: what is other than to hear the level's own Guide, which is trained along, as it speaks; nothing where it is that
    """
    if run["agent"] != "guided":
        return ""
    found = [f"Guide of {other}" for other in Path(run["guide"]).parts[-3:-2] if other != level]
    found += ["untrained"] if run["guide"] == UNTRAINED else []
    found += ["frozen"] if run["freeze_guide"] else []
    found += [run["hears"]] if run["hears"] != "spoken" else []
    return ", ".join(found)


def channel(folder: Path, guide: str | None) -> dict[str, Any]:
    """
    :param folder: of an agent
    :param guide: folder of the Guide that it hears, as its run has it
    :return: the condition of that Guide, and the form of the messages; nothing of an agent without a channel
    """
    own = read_json(folder / AGENT)["kwargs"]
    speaker = own["guide"]["kwargs"] if "guide" in own else own
    if "message_length" not in speaker:
        return {}
    form = {"channel": "discrete", **{name: speaker[name] for name in FORM if name in speaker}}
    return {"guide": "" if guide is None else Path(guide).name, **form}


def speech(path: Path) -> dict[str, Any]:
    """
    :param path: of a speech.json, which need not exist
    :return: how many messages the agent uses, the entropy of that use in nats, how many of them mean an action, how many
        actions they mean, and how far it obeys
    """
    if not path.exists():
        return {}
    found = read_json(path)
    words, obedience = [entry for entry in found["dictionary"] if entry["means_it"]], found["obedience"]
    share = np.array([entry["frames"] for entry in found["dictionary"]]) / sum(e["frames"] for e in found["dictionary"])
    return {
        "messages_used": len(share),
        "usage_entropy": round(float(-(share * np.log(share)).sum()), 5),
        "words": len(words),
        "actions_meant": len({entry["action"] for entry in words}),
        "obeyed": obedience["raw"],
        "beyond_chance": None if obedience["corrected"] is None else round(obedience["corrected"], 5),
    }


def short(number: str) -> str:
    """:return: a number with five digits, as it stands where that is enough"""
    return f"{float(number):.5g}" if "." in number else number


def merge(path: Path, rows: list[dict[str, Any]]) -> None:
    """
    :param path: of a table, which need not exist
    :param rows: that replace those of the same level, condition and seed
    """

    def key(row: dict[str, Any]) -> tuple[str, str, int]:
        return row["level"], row["condition"], int(row["seed"])

    new = {key(row) for row in rows}
    kept = [row for row in (read_table(path) if path.exists() else []) if key(row) not in new]
    write_table(path, sorted([*kept, *rows], key=key))
