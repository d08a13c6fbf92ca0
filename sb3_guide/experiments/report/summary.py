"""The numbers of a finished run in one dictionary, which is what summary.json holds."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import linregress

from sb3_guide.experiments.stages.runs import intact, read_table
from sb3_guide.experiments.stages.statistics import wilson_interval
from sb3_guide.files import read_json

SPEECH = {name: name for name in ("cic", "uniform_cic", "message_entropy")}
SUCCESS = {"curve": "success_rate"}
CURVES = {
    "learner": SUCCESS,
    "guide": {**SUCCESS, **SPEECH},
    "guided": {**SUCCESS, **SPEECH},
}  # columns of progress.csv by name
TREND_EPOCHS = 3  # fewer have no trend


def summarise(folder: Path, levels: Sequence[str], seeds: int, wall_seconds: float) -> dict[str, Any]:
    """
    :param folder: of a finished run
    :param levels: names of its levels, at least one
    :param seeds: how often stages 2 and 3 were run
    :param wall_seconds: that the run has taken
    :return: the block of the level, or with several levels {"levels": {name: block}}; and "wall_seconds"
    :raises FileNotFoundError: if a stage's result is missing
    :raises ValueError: if one is damaged
    """
    with intact(folder):
        blocks = {level: summarise_level(folder / level, seeds) for level in levels}
    content = blocks[levels[0]] if len(blocks) == 1 else {"levels": blocks}
    return {**content, "wall_seconds": wall_seconds}


def summarise_level(folder: Path, seeds: int) -> dict[str, Any]:
    """
    :param folder: of one level of a run
    :param seeds: how many
    :return: success rates in [0, 1] with 95 % Wilson intervals, curves (one value an epoch), trends, and seconds by stage;
        for each agent over the seeds, and under "runs" for every seed alone
    """
    demos = read_json(folder / "demos" / "train.json")
    runs: list[dict[str, Any]] = [{"seed": seed, **summarise_run(folder / f"seed{seed}")} for seed in range(seeds)]
    guided = over_seeds([run["guided"] for run in runs])
    return {
        "level": folder.name,
        "seeds": list(range(seeds)),
        "expert": outcome(read_json(folder / "evaluation" / "expert.json")),
        "demos": {key: demos[key] for key in ("episodes", "frames", "mean_length")},
        "learner": over_seeds([run["learner"] for run in runs]),
        "guide": over_seeds([run["guide"] for run in runs]),
        "guided": guided,
        "trends": {name: trend(guided[name]) for name in SPEECH},
        "early": early_lead(runs),
        "stage_seconds": stage_seconds(folder, seeds),
        "versions": read_json(folder / "expert" / "run.json")["versions"],
        "runs": runs,
    }


def summarise_run(folder: Path) -> dict[str, dict[str, Any]]:
    """:return: outcome and curves of each agent of one seed"""
    return {
        agent: {**outcome(read_json(folder / agent / "evaluation.json")), **read_curves(folder / agent, columns)}
        for agent, columns in CURVES.items()
    }


def outcome(evaluation: dict[str, Any]) -> dict[str, float]:
    """:return: what the summary keeps of an evaluation"""
    return {key: evaluation[key] for key in ("success_rate", "low", "high", "mean_length", "episodes", "successes")}


def read_curves(folder: Path, columns: dict[str, str]) -> dict[str, list[float]]:
    """
    :param folder: of a cloned agent
    :param columns: of its progress.csv by name
    :return: the values of the columns at the end of each epoch, and the bounds of the success rates' 95 % Wilson intervals
    """
    table = read_table(folder / "progress.csv")
    rows = [row for row in table if float(row["epoch"]) >= 1 and float(row["epoch"]).is_integer()]
    curves = {name: [float(row[column]) for row in rows] for name, column in columns.items()}
    missions = read_json(folder / "run.json")["config"]["validation_episodes"]
    intervals = [wilson_interval(round(rate * missions), missions) for rate in curves["curve"]]
    return curves | {"curve_low": [low for low, _ in intervals], "curve_high": [high for _, high in intervals]}


def over_seeds(agents: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """
    :param agents: outcome and curves of one kind of agent, one a seed
    :return: the same: means over the seeds, sums of episodes and successes, and the Wilson interval of those
    """
    sums = {key: sum(agent[key] for agent in agents) for key in ("episodes", "successes")}
    low, high = wilson_interval(sums["successes"], sums["episodes"])
    own = {*sums, "low", "high", "curve_low", "curve_high"}  # an interval's bounds have no mean
    means = {key: np.mean([agent[key] for agent in agents], axis=0).tolist() for key in agents[0] if key not in own}
    return {**means, **sums, "low": low, "high": high}


def trend(curve: Sequence[float]) -> dict[str, float | None]:
    """
    :param curve: one value an epoch
    :return: slope per epoch of the linear trend, its intercept at epoch 0, and the p-value of no trend, which takes the epochs
        for independent and so is too small; None where a curve is too short or constant
    """
    if len(curve) < TREND_EPOCHS or min(curve) == max(curve):
        return {"slope": None, "intercept": None, "p_value": None}
    fit = linregress(np.arange(1, len(curve) + 1), curve)
    return {"slope": float(fit.slope), "intercept": float(fit.intercept), "p_value": float(fit.pvalue)}


def early_lead(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """
    Compare guided Learner and Learner in the first quarter of the epochs, rounded up.

    :param runs: one a seed
    :return: number of epochs compared, mean difference of the validation success rates (positive: the guided Learner is
        ahead), and the same for each seed
    """
    epochs = math.ceil(len(runs[0]["learner"]["curve"]) / 4)
    curves = np.array([[run[agent]["curve"][:epochs] for agent in ("guided", "learner")] for run in runs])  # seeds, 2, epochs
    by_seed = (curves[:, 0] - curves[:, 1]).mean(axis=1)
    return {"epochs": epochs, "difference": float(by_seed.mean()), "by_seed": by_seed.tolist()}


def stage_seconds(folder: Path, seeds: int) -> dict[str, float]:
    """
    :param folder: of one level of a run
    :param seeds: how many
    :return: seconds by stage, named by its folder or file inside the level's folder
    """
    files = {name: name for name in ("demos/train", "demos/validation", "demos/analysis", "evaluation/expert")}
    files["expert"] = "expert/run"
    for run in (f"seed{seed}" for seed in range(seeds)):
        files |= {f"{run}/{agent}": f"{run}/{agent}/run" for agent in CURVES}
        files |= {f"{run}/analysis/{agent}": f"{run}/analysis/{agent}/analysis" for agent in ("guide", "guided")}
    return {name: read_json(folder / f"{file}.json")["seconds"] for name, file in files.items()}
