"""A whole study with one call: the packaged Snakemake workflow, then its report."""

import shlex
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sb3_guide.experiments.workflow.conditions import load_catalogue
from sb3_guide.experiments.workflow.running import compiling_seconds, locked, run_workflow
from sb3_guide.files import write_json

STAGES = "stages"  # the study that has a report of its own
# What writes the pages of all others. The modules are imported when the runs are done, as that takes seconds.
PAGES = {"guidance": ("guidance", "write_pages"), "channel": ("channel", "write_page")}


def reproduce(
    study: str, levels: Sequence[str], seeds: int | None, cores: int, out: Path, conditions: Path | None = None
) -> None:
    """
    Do every run of a study that is missing, and report it. What is finished in the folder is kept; what was interrupted goes
    on; a run whose settings have changed runs anew.

    :param study: name; "stages" ends with summary.json and report.html, others with the tables of all runs in the folder
    :param levels: names or ids, of the study's, such as "GoToObj"; none takes all of them
    :param seeds: how often stages 2 and 3 are repeated, with the seeds 0, 1, ...; None takes the study's own number
    :param cores: of this machine that may be used; results don't depend on it
    :param out: folder of the runs, made if need be
    :param conditions: YAML with conditions and studies of the caller's own
    :raises ValueError: for an unknown study, condition or level, one without hyper-parameters or expert, or no seed or core
    :raises RuntimeError: if Snakemake isn't installed, the folder is in use or can't be used, or a stage fails
    """
    catalogue = load_catalogue(conditions)
    runs = catalogue.runs(study, levels, seeds)
    if cores < 1:
        raise ValueError(f"The number of cores is {cores}: expected at least 1")
    if find_spec("snakemake") is None:
        raise RuntimeError("Snakemake isn't installed: pip install 'sb3-guide[experiments]', on Python 3.11 or newer")
    names = list(dict.fromkeys(run.level for run in runs))
    folder = out.resolve()
    with locked(folder):
        config = {"study": study, "levels": list(levels), "seeds": seeds}
        config["conditions"] = None if conditions is None else str(conditions.resolve())
        seconds = run_workflow(config, cores, folder)
        if study == STAGES:
            repeats = 1 + max(run.seed for run in runs)
            command = ["sb3-guide", "reproduce", *names, "--seeds", str(repeats), "--cores", str(cores), "--out", str(out)]
            command += [] if conditions is None else ["--conditions", str(conditions)]
            summary = report_stages(folder, names, repeats, seconds, shlex.join(command))
            print(times(summary, compiling_seconds(folder)))
            print(f"Done: see {out / 'report.html'}, and summary.json beside it.")
        else:
            from sb3_guide.experiments.report.tables import write_tables

            write_tables(folder, folder / "report")
            write_pages(catalogue.studies[study].page, folder / "report")
            print(f"Done: see {out / 'report' / 'README.md'}.")


def write_pages(page: str, folder: Path) -> None:
    """
    :param page: a key of PAGES
    :param folder: with curves.csv and finals.csv
    """
    module, function = PAGES[page]
    getattr(import_module(f"sb3_guide.experiments.report.{module}"), function)(folder)


def report_stages(folder: Path, levels: Sequence[str], seeds: int, seconds: float, command: str) -> dict[str, Any]:
    """
    Write summary.json and report.html.

    :param folder: of a finished run
    :param levels: names of its levels
    :param seeds: how often stages 2 and 3 were run
    :param seconds: that the run has taken
    :param command: that reproduces it
    :return: the summary
    """
    from sb3_guide.experiments.report.page import write_report
    from sb3_guide.experiments.report.summary import summarise

    summary = summarise(folder, levels, seeds, seconds)
    write_json(folder / "summary.json", summary)
    write_report(folder, summary, command)
    return summary


def times(summary: dict[str, Any], compiling: float | None) -> str:
    """
    :param summary: of a run
    :param compiling: seconds that the engine compiled for; None if it was compiled before
    :return: what the run has taken, in words
    """
    from sb3_guide.experiments.report.page import duration, stage_times

    blocks = list(summary["levels"].values()) if "levels" in summary else [summary]
    stages = [f"{row['title']} {duration(row['seconds'])}" for row in map(sum_of, zip(*map(stage_times, blocks), strict=True))]
    engine = [] if compiling is None else [f"compiling the engine, once on this machine, {duration(compiling)}"]
    return (
        f"The run took {duration(summary['wall_seconds'])} (minutes:seconds). Side by side: {'; '.join([*engine, *stages])}."
    )


def sum_of(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """:return: title and seconds of the same kind of stage on several levels"""
    return {"title": rows[0]["title"], "seconds": sum(row["seconds"] for row in rows)}
