"""A whole study with one call: the packaged Snakemake workflow, then its report."""

import shlex
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from sb3_guide.experiments.report.channel import write_page
from sb3_guide.experiments.report.guidance import write_pages
from sb3_guide.experiments.report.page import write_report
from sb3_guide.experiments.report.summary import summarise
from sb3_guide.experiments.report.tables import write_tables
from sb3_guide.experiments.workflow.conditions import load_catalogue
from sb3_guide.experiments.workflow.running import locked, run_workflow
from sb3_guide.files import write_json

STAGES = "stages"  # the study that has a report of its own
PAGES = {"guidance": write_pages, "channel": write_page}  # of all others


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
            summary = summarise(folder, names, repeats, seconds)
            write_json(folder / "summary.json", summary)
            command = ["sb3-guide", "reproduce", *names, "--seeds", str(repeats), "--cores", str(cores), "--out", str(out)]
            command += [] if conditions is None else ["--conditions", str(conditions)]
            write_report(folder, summary, shlex.join(command))
            print(f"Done: see {out / 'report.html'}, and summary.json beside it.")
        else:
            write_tables(folder, folder / "report")
            PAGES[catalogue.studies[study].page](folder / "report")
            print(f"Done: see {out / 'report' / 'README.md'}.")
