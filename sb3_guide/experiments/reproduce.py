"""The whole experiment with one call: the packaged Snakemake workflow, then summary and report."""

import shlex
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from sb3_guide.envs import level_of
from sb3_guide.experiments.report.page import write_report
from sb3_guide.experiments.report.summary import summarise
from sb3_guide.experiments.stages.configs import load_config
from sb3_guide.experiments.workflow.running import locked, run_workflow
from sb3_guide.policies.folder import write_json


def reproduce(levels: Sequence[str], seeds: int, cores: int, out: Path) -> None:
    """
    Train the expert, record its demonstrations, clone Learner, Guide and guided Learner, evaluate and analyse them, and write
    summary.json and report.html. What is finished in the folder is kept; what was interrupted goes on.

    :param levels: names or ids, such as "GoToObj"
    :param seeds: how often stages 2 and 3 are repeated, with the seeds 0, 1, ...; the expert is trained once a level
    :param cores: of this machine that may be used; results don't depend on it
    :param out: folder of the run, made if need be
    :raises ValueError: for an unknown level, one without hyper-parameters, no level, or fewer than one seed or core
    :raises RuntimeError: if Snakemake isn't installed, the folder is in use or can't be used, or a stage fails
    """
    names = list(dict.fromkeys(level_of(level).name for level in levels))
    check_arguments(names, seeds, cores)
    folder = out.resolve()
    with locked(folder):
        seconds = run_workflow(names, seeds, cores, folder)
        summary = summarise(folder, names, seeds, seconds)
        write_json(folder / "summary.json", summary)
        command = ["sb3-guide", "reproduce", *names, "--seeds", str(seeds), "--cores", str(cores), "--out", str(out)]
        write_report(folder, summary, shlex.join(command))
    print(f"Done: see {out / 'report.html'}, and summary.json beside it.")


def check_arguments(levels: Sequence[str], seeds: int, cores: int) -> None:
    """:raises ValueError, RuntimeError: as :func:`reproduce` does, before anything is made"""
    if not levels:
        raise ValueError("There is nothing to reproduce: name at least one level, such as GoToObj")
    for level in levels:
        for stage in ("ppo", "bc"):
            load_config(stage, level)
    for what, number in (("seeds", seeds), ("cores", cores)):
        if number < 1:
            raise ValueError(f"The number of {what} is {number}: expected at least 1")
    if find_spec("snakemake") is None:
        raise RuntimeError("Snakemake isn't installed: pip install 'sb3-guide[experiments]', on Python 3.11 or newer")
