"""Conditions and studies: which runs of stages 2 and 3 there are, as conditions.yml says."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any, NamedTuple

from sb3_guide.experiments.stages.clone import UNTRAINED, check_agent, override, shared_config
from sb3_guide.experiments.stages.configs import load_config
from sb3_guide.experiments.stages.levels import join_levels, split_levels
from sb3_guide.experts import expert_folder
from sb3_guide.files import check_types, filled, read_yaml

PACKAGED = Path(__file__).with_name("conditions.yml")
EXPERTS = ("trained", "pretrained")
PAGES = ("guidance", "channel")
NAME = re.compile(r"[A-Za-z0-9+-]+")  # of a condition: it becomes part of paths and of commands
MAX_SEEDS = 1000


@dataclass(frozen=True)
class Condition:
    """
    How an agent is cloned. A reference is the name of a condition, of the same level, or ``condition@level``.

    :param agent: "learner", "guide" or "guided"
    :param guide: reference to the condition whose Guide speaks, or "untrained"
    :param freeze_guide: keep that Guide as it is
    :param hears: intervention that its messages pass through
    :param init: reference to the condition whose weights a Learner starts from
    :param params: hyper-parameters to override
    :raises TypeError: if something is of another type
    :raises ValueError: see :func:`~sb3_guide.experiments.stages.clone.check_agent`, whose options are the keys here
    """

    agent: str
    guide: str | None = None
    freeze_guide: bool = False
    hears: str = "spoken"
    init: str | None = None
    params: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_types(self)
        check_agent(self.agent, self.guide, self.freeze_guide, self.hears, self.init)
        if self.init == UNTRAINED:
            raise ValueError("init is 'untrained': leave it out to start from nothing")
        if unfinished := [name for name in self.references() if name.endswith("@")]:
            raise ValueError(f"{unfinished[0]!r} names no level: expected condition or condition@level")

    def references(self) -> list[str]:
        """:return: to the conditions that have to be run before"""
        return [name for name in (self.guide, self.init) if name not in (None, UNTRAINED)]


@dataclass(frozen=True)
class Grid:
    """
    Every condition on every level with every seed.

    :param conditions: names
    :param seeds: how many, from 0
    :param levels: names; None takes those that the caller names
    :raises TypeError: if something is of another type
    :raises ValueError: if there are too many seeds or none, or no conditions
    """

    conditions: list[str]
    seeds: int
    levels: list[str] | None = None

    def __post_init__(self) -> None:
        check_types(self)
        check_seeds(self.seeds)
        if not self.conditions:
            raise ValueError("a grid of no conditions: expected at least one")

    def names(self, chosen: list[str]) -> list[str]:
        """:return: of its levels, or those that the caller names"""
        return chosen if self.levels is None else [names_of(level) for level in self.levels]


@dataclass(frozen=True)
class Study:
    """
    :param grids: whose runs it has
    :param expert: "trained" along, or the "pretrained" one that is shipped
    :param analyze: conditions whose agents are analysed
    :param speak: conditions whose agents are spoken to, to tell which messages they use and how far they obey
    :param page: which of PAGES the finished runs are reported on
    :raises TypeError: if something is of another type
    :raises ValueError: if there is no such expert or page
    """

    grids: list[Grid]
    expert: str = "pretrained"
    analyze: list[str] = field(default_factory=list)
    speak: list[str] = field(default_factory=list)
    page: str = "guidance"

    def __post_init__(self) -> None:
        check_types(self)
        if self.expert not in EXPERTS:
            raise ValueError(f"expert {self.expert!r} is unknown: expected one of {', '.join(EXPERTS)}")
        if self.page not in PAGES:
            raise ValueError(f"page {self.page!r} is unknown: expected one of {', '.join(PAGES)}")


@dataclass(frozen=True)
class Content:
    """
    Of a file.

    :param conditions: by name
    :param studies: by name
    :raises TypeError: if something is of another type
    """

    conditions: dict[Any, Any] = field(default_factory=dict)
    studies: dict[Any, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_types(self)


class Run(NamedTuple):
    """
    A condition on a level with a seed.

    :param level: name, or several joined by "+"
    :param seed: of weights, order and messages
    :param condition: name
    """

    level: str
    seed: int
    condition: str

    @property
    def folder(self) -> str:
        """Inside the folder of all runs."""
        return f"{self.level}/seed{self.seed}/{self.condition}"

    def source(self, reference: str) -> "Run":
        """
        :param reference: to a condition, such as "guide" or "guide@GoToLocal"
        :return: the run that it means here
        """
        condition, _, level = reference.partition("@")
        return Run(names_of(level) if level else self.level, self.seed, condition)


class Catalogue(NamedTuple):
    """
    All that can be run.

    :param conditions: by name
    :param studies: by name
    """

    conditions: dict[str, Condition]
    studies: dict[str, Study]

    def runs(self, study: str, levels: Sequence[str] = (), seeds: int | None = None) -> list[Run]:
        """
        :param study: name
        :param levels: names, of the study's, to run; none means all of them
        :param seeds: how many instead of the study's own number; None takes that
        :return: every run of the study, and every one that these need, once
        :raises ValueError: if something is unknown, there is no run, or a level has no hyper-parameters or expert
        """
        if study not in self.studies:
            raise ValueError(f"study {study!r} is unknown: expected one of {', '.join(self.studies)}")
        if seeds is not None:
            check_seeds(seeds)
        chosen = [names_of(level) for level in levels]
        grids = self.studies[study].grids
        own = {level for grid in grids for level in grid.names(chosen)}
        if not own or (unknown := [level for level in chosen if level not in own]):
            named = ", ".join(unknown) if own else "levels of its own"
            expected = ", ".join(sorted(own)) or "at least one to be named, such as GoToObj"
            raise ValueError(f"study {study!r} has no {named}: expected {expected}")
        runs = [
            Run(level, seed, condition)
            for grid in grids
            for level in grid.names(chosen)
            if level in (chosen or own)
            for seed in range(grid.seeds if seeds is None else seeds)
            for condition in grid.conditions
        ]
        needed = list(dict.fromkeys(each for run in runs for each in self._with_sources(run)))
        for run in dict.fromkeys(run._replace(seed=0) for run in needed):
            self._check(run, self.studies[study].expert)
        return needed

    def _with_sources(self, run: Run) -> list[Run]:
        """:return: what a run needs, before it, and the run"""
        sources = [run.source(reference) for reference in self.conditions[run.condition].references()]
        return [*(each for source in sources for each in self._with_sources(source)), run]

    def _check(self, run: Run, expert: str) -> None:
        """:raises ValueError: if the run has no hyper-parameters or no expert"""
        levels = split_levels(run.level)
        config = override(shared_config(levels, None), self.params(run))
        if config["train_episodes"] > config["recorded_episodes"]:
            raise ValueError(
                f"condition {run.condition!r} is to train on {config['train_episodes']} episodes of {run.level}, of which "
                f"{config['recorded_episodes']} are recorded: expected at most as many"
            )
        for level in levels:
            if expert == "pretrained":
                expert_folder(level)
            else:
                load_config("ppo_lstm", level)

    def params(self, run: Run) -> list[str]:
        """:return: hyper-parameters to override, as the command line takes them"""
        return [f"{name}:{json.dumps(value)}" for name, value in self.conditions[run.condition].params.items()]

    def options(self, run: Run) -> list[str]:
        """:return: what the command line of `sb3-guide clone` says of a run, beyond level, seed and folders of its own"""
        condition = self.conditions[run.condition]
        options = ["--agent", condition.agent]
        if condition.guide is not None:
            guide = UNTRAINED if condition.guide == UNTRAINED else run.source(condition.guide).folder
            options += ["--guide", guide]
        if condition.freeze_guide:
            options += ["--freeze-guide"]
        if condition.hears != "spoken":
            options += ["--hears", condition.hears]
        if condition.init is not None:
            options += ["--init", run.source(condition.init).folder]
        for param in self.params(run):
            options += ["--params", param]
        return options


def names_of(levels: str) -> str:
    """:return: name of a level, or names of several joined by "+", as folders have them"""
    return join_levels(split_levels(levels))


def check_seeds(seeds: int) -> None:
    """:raises ValueError: if there are too many of them or none"""
    if not 1 <= seeds <= MAX_SEEDS:
        raise ValueError(f"The number of seeds is {seeds}: expected 1 to {MAX_SEEDS}")


def load_catalogue(file: Path | None = None) -> Catalogue:
    """
    :param file: YAML of conditions and studies to add to the packaged ones; None adds nothing
    :raises FileNotFoundError: if the file does not exist
    :raises ValueError: if it is no such YAML, or names what does not exist
    """
    conditions: dict[str, Condition] = {}
    studies: dict[str, Study] = {}
    for path in (PACKAGED, *([] if file is None else [file])):
        try:
            content = filled(Content, "the file", read_yaml(path) or {})
            conditions |= {name: filled(Condition, f"condition {name}", entry) for name, entry in content.conditions.items()}
            studies |= {name: study_of(name, entry) for name, entry in content.studies.items()}
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path} holds no usable conditions and studies: {error}") from error
    check_order(conditions)
    used = [
        *(reference.partition("@")[0] for condition in conditions.values() for reference in condition.references()),
        *(name for study in studies.values() for grid in study.grids for name in grid.conditions),
        *(name for study in studies.values() for name in (*study.analyze, *study.speak)),
    ]
    for name in used:
        if name not in conditions:
            raise ValueError(f"condition {name!r} is unknown: expected one of {', '.join(conditions)}")
    check_references(conditions)
    return Catalogue(conditions, studies)


def study_of(name: str, entry: Any) -> Study:
    """
    :param name: of the study
    :param entry: of a file
    :raises TypeError: if something is of another type
    :raises ValueError: if something is unknown, missing or out of range
    """
    if isinstance(entry, dict) and isinstance(entry.get("grids"), list):
        entry = {**entry, "grids": [filled(Grid, f"a grid of study {name}", grid) for grid in entry["grids"]]}
    return filled(Study, f"study {name}", entry)


def check_references(conditions: dict[str, Condition]) -> None:
    """
    :param conditions: by name
    :raises ValueError: if one waits for an agent of a kind that it has no use for
    """
    for name, condition in conditions.items():
        for reference, kinds in ((condition.guide, ("guide",)), (condition.init, ("learner", "guide"))):
            kind = None if reference in (None, UNTRAINED) else conditions[reference.partition("@")[0]].agent
            if kind is not None and kind not in kinds:
                raise ValueError(f"condition {name!r} needs {reference!r}, a {kind}: expected a {' or a '.join(kinds)}")


def check_order(conditions: dict[str, Condition]) -> None:
    """
    :param conditions: by name
    :raises ValueError: if a name can't be part of a path, or conditions wait for each other
    """
    for name in conditions:
        if not (isinstance(name, str) and NAME.fullmatch(name)):
            raise ValueError(f"condition {name!r}: expected a name of letters, digits, + and -")
    needed = {name: [each.partition("@")[0] for each in condition.references()] for name, condition in conditions.items()}
    try:
        TopologicalSorter(needed).prepare()
    except CycleError as error:
        raise ValueError(f"conditions wait for each other: {' needs '.join(error.args[1])}") from error
