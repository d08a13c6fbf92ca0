"""The report of a run: one HTML file that holds its figures, and needs neither network nor JavaScript."""

import io
import re
from base64 import b64encode
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from PIL import Image

from sb3_guide.experiments.report.figures import GUIDE, GUIDED, action_figure, influence_figure, success_figure
from sb3_guide.experiments.report.findings import early_finding, influence_finding, nats, percent, signed, training_finding
from sb3_guide.files import read_json, write_text
from sb3_guide.metrics import conditional

AGENTS = {"expert": "Expert", "learner": "Learner", "guide": "Guide", "guided": "Guided Learner"}
SPEAKERS = {"guide": ("Guide after stage 2", GUIDE), "guided": ("Guided Learner after stage 3", GUIDED)}
STAGES = {  # title by first part of a stage's name
    "expert": "Expert (stage 1)",
    "demos": "Demonstrations",
    "learner": "Learner (stage 2)",
    "guide": "Guide (stage 2)",
    "guided": "Guided Learner (stage 3)",
    "evaluation": "Evaluations",
    "analysis": "Analyses",
}


def write_report(folder: Path, summary: dict[str, Any], command: str) -> None:
    """
    Write report.html atomically.

    :param folder: of a finished run
    :param summary: of the run
    :param command: that reproduces it
    :raises FileNotFoundError: if an analysis or an animation is missing
    """
    environment = Environment(
        loader=PackageLoader("sb3_guide.experiments.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(nats=nats, percent=percent, signed=signed, duration=duration)
    blocks = list(summary["levels"].values()) if "levels" in summary else [summary]
    page = environment.get_template("report.html.j2").render(
        levels=[level_content(folder / block["level"], block) for block in blocks],
        agents=AGENTS,
        wall_seconds=summary["wall_seconds"],
        command=command,
        versions=blocks[0]["versions"],
    )
    write_text(folder / "report.html", page)


def level_content(folder: Path, block: dict[str, Any]) -> dict[str, Any]:
    """
    :param folder: of one level of a run
    :param block: of the level in the summary
    :return: the block, and what the page shows besides
    """
    folders = {agent: folder / "seed0" / "analysis" / agent for agent in SPEAKERS}
    analyses = {agent: read_json(folders[agent] / "analysis.json") for agent in SPEAKERS}
    animation = folders["guided"] / "episode.gif"
    counts = np.sum([analysis["counts"] for analysis in analyses.values()], axis=0)  # messages, actions
    messages, actions = analyses["guide"]["messages"], analyses["guide"]["actions"]
    used = np.flatnonzero(counts.sum(axis=1))
    return {
        **block,
        "findings": [training_finding(block, messages[0]), early_finding(block), influence_finding(block)],
        "success_figure": Markup(success_figure(block)),
        "influence_figure": Markup(influence_figure(block)),
        "speakers": [
            {
                "title": title,
                "figure": Markup(action_figure(analyses[agent], used, colour, f"{block['level']} {title}")),
                "habits": habits(analyses[agent]),
            }
            for agent, (title, colour) in SPEAKERS.items()
        ],
        "messages": messages,
        "unused_messages": [message for index, message in enumerate(messages) if index not in used],
        "unused_actions": [action for action, count in zip(actions, counts.sum(axis=0), strict=True) if not count],
        "animation": embed(animation.read_bytes(), "gif"),
        "still": embed(first_frame(animation), "png"),
        "stages": stage_times(block),
    }


def habits(analysis: dict[str, Any]) -> str:
    """
    :param analysis: of an agent that speaks
    :return: the commonest action after each message that it used, in words
    """
    counts = np.array(analysis["counts"])
    rates = conditional(counts)
    return "; ".join(
        f"{analysis['messages'][message]}: {analysis['actions'][rates[message].argmax()]} {rates[message].max():.0%}"
        for message in np.flatnonzero(counts.sum(axis=1))
    )


def stage_times(block: dict[str, Any]) -> list[dict[str, Any]]:
    """
    :param block: of a level in the summary
    :return: for each kind of stage its title, how often it ran, seconds altogether, and seconds relative to the longest
    """
    seconds: dict[str, list[float]] = {title: [] for title in STAGES.values()}
    for stage, value in block["stage_seconds"].items():
        seconds[STAGES[re.sub(r"^seed\d+/", "", stage).split("/")[0]]].append(value)
    longest = max(sum(values) for values in seconds.values())
    return [
        {"title": title, "runs": len(values), "seconds": sum(values), "share": sum(values) / longest}
        for title, values in seconds.items()
    ]


def duration(seconds: float) -> str:
    """:return: such as "1:05" or "2:00:07" """
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def embed(picture: bytes, kind: str) -> str:
    """
    :param picture: content of its file
    :param kind: "gif" or "png"
    :return: URL that holds it
    """
    return f"data:image/{kind};base64,{b64encode(picture).decode()}"


def first_frame(animation: Path) -> bytes:
    """
    :param animation: GIF
    :return: PNG for those who want nothing to move
    """
    file = io.BytesIO()
    with Image.open(animation) as picture:
        picture.save(file, "PNG")
    return file.getvalue()
