"""The tables of a study, read and checked."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from sb3_guide.experiments.report.contrasts import Contrast, area, horizon_of, paired

CURVES = {"level", "condition", "seed", "episodes", "success_rate", "cic", "message_entropy", "uniform_cic"}
FINALS = {"level", "condition", "seed", "train_episodes", "n_epochs", "success_rate"}


@dataclass(frozen=True)
class Study:
    """
    All finished runs.

    :param curves: a row a validation, as :func:`~sb3_guide.experiments.report.tables.write_tables` writes them
    :param finals: a row a run
    """

    curves: pd.DataFrame
    finals: pd.DataFrame

    def has(self, level: str, condition: str) -> bool:
        """:return: whether any run of it has finished"""
        return bool(((self.finals["level"] == level) & (self.finals["condition"] == condition)).any())

    def levels(self) -> list[str]:
        """:return: names of single levels, in the order of the paper's figures"""
        order = ["GoToObj", "GoToLocal", "GoToObjMaze", "PickupLoc", "PutNextLocal", "GoTo"]
        found = [level for level in self.finals["level"].unique() if "+" not in level]
        return sorted(found, key=lambda level: (order.index(level) if level in order else len(order), level))

    def success(self, level: str, condition: str) -> pd.DataFrame:
        """:return: validation success by episodes seen (index) and seed (columns)"""
        chosen = self.curves[(self.curves["level"] == level) & (self.curves["condition"] == condition)]
        return chosen.pivot(index="episodes", columns="seed", values="success_rate")

    def final(self, level: str, condition: str) -> pd.Series:
        """:return: success on the analysis missions by seed"""
        chosen = self.finals[(self.finals["level"] == level) & (self.finals["condition"] == condition)]
        return chosen.set_index("seed")["success_rate"].sort_index()

    def episodes(self, level: str, condition: str, epochs: int | None = None) -> int:
        """:return: episodes that an agent of this condition has seen in so many epochs, or in all"""
        chosen = self.finals[(self.finals["level"] == level) & (self.finals["condition"] == condition)].iloc[0]
        return int(chosen["train_episodes"] * (chosen["n_epochs"] if epochs is None else epochs))

    def contrast(self, kind: str, level: str, a: str, b: str) -> Contrast | None:
        """
        :param kind: of the claim, as claims.yml has it
        :return: A minus B, over the seeds that both have; None if one was not run or they share no seed
        """
        if not (self.has(level, a) and self.has(level, b)):
            return None
        if kind.endswith("in-the-end"):
            finals = pd.concat([self.final(level, a), self.final(level, b)], axis=1, join="inner").to_numpy()
            return paired(level, a, b, None, finals[:, 0], finals[:, 1]) if len(finals) else None
        curves = self.success(level, a), self.success(level, b)
        seeds = sorted(set(curves[0].columns) & set(curves[1].columns))
        if not seeds:
            return None
        curves = curves[0][seeds], curves[1][seeds]
        horizon = horizon_of(*curves)
        areas = [[area(curve.index.to_numpy(), curve[seed].to_numpy(), horizon) for seed in seeds] for curve in curves]
        return paired(level, a, b, horizon, np.array(areas[0]), np.array(areas[1]))


def read_study(folder: Path) -> Study:
    """
    :param folder: with curves.csv and finals.csv
    :raises FileNotFoundError: if one is missing
    :raises ValueError: if one is empty or lacks a column
    """
    tables = []
    for name, columns in (("curves.csv", CURVES), ("finals.csv", FINALS)):
        path = folder / name
        if not path.is_file():
            raise FileNotFoundError(f"{path} does not exist: expected the tables of a study, as sb3-guide collect writes them")
        try:
            table = pd.read_csv(path)
        except ValueError as error:
            raise ValueError(f"{path} is no table: {error}") from error
        if missing := columns - set(table.columns):
            raise ValueError(f"{path} lacks {', '.join(sorted(missing))}: expected the columns that sb3-guide collect writes")
        if table.empty:
            raise ValueError(f"{path} is empty: expected at least one run")
        tables.append(table)
    return Study(*tables)


def in_words(seeds: Sequence[int]) -> str:
    """
    :param seeds: how many each condition has
    :return: such as "2 to 5 seeds"
    """
    fewest, most = min(seeds), max(seeds)
    return f"{fewest} to {most} seeds" if fewest < most else f"{most} seed{'s' * (most > 1)}"
