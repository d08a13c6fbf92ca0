"""Results pages on the claims of section 4, generated from the tables of a study."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.stats import t

from sb3_guide.experiments.report.contrasts import Contrast, area, corrected, episodes_to, verdict, verdict_of_all
from sb3_guide.experiments.report.curves import SIZES, draw_curves, draw_sizes
from sb3_guide.experiments.report.study import Study, read_study
from sb3_guide.experiments.workflow.conditions import Run, load_catalogue
from sb3_guide.files import write_text

CLAIMS = Path(__file__).with_name("claims.yml")
KINDS = ("faster", "as-good", "as-good-in-the-end", "better-in-the-end")
AGENTS = ("learner", "guide", "guided")
THRESHOLDS = (0.5, 0.9, 0.95)
PAGES = {
    "intra": "Guidance within a level (section 4.1)",
    "curriculum": "Guidance across levels (section 4.2)",
    "multilevel": "One Guide for several levels (section 4.3)",
    "lowdata": "Fewer demonstrations",
}
FIGURES: dict[str, list[tuple[str, str, list[str], int | None]]] = {  # by page: file, caption, conditions, epochs shown
    "intra": [
        ("intra", "Learner and guided Learner, as in the paper's figure 4", ["learner", "guided"], None),
        (
            "intra-controls",
            "The same with all controls, the first two epochs",
            ["learner", "guided", "transfer", "frozen", "reader", "untrained", "silent", "random", "shuffled"],
            2,
        ),
        ("intra-guide", "What the Guide itself took to learn", ["learner", "guide"], None),
    ],
    "curriculum": [
        (
            "curriculum",
            "As in the paper's figure 5, the first two epochs",
            [
                *("learner", "guided", "guided-by-GoToLocal", "guided-by-PickupLoc", "guided-by-PutNextLocal"),
                *("pretrained-on-GoToLocal", "pretrained-on-PickupLoc", "pretrained-on-PutNextLocal"),
            ],
            2,
        )
    ],
    "multilevel": [("multilevel", "As in the paper's figure 6", ["learner", "guided", "guided-by-all"], 2)],
    "lowdata": [],  # a figure of its own
}
LEVELS = {"curriculum": ["PickupLoc", "PutNextLocal"], "multilevel": ["GoToLocal", "PickupLoc", "PutNextLocal"]}


@dataclass(frozen=True)
class Judged:
    """
    A claim and what the runs say of it.

    :param claim: entry of claims.yml
    :param contrasts: that were run
    :param p_values: corrected, of each
    :param missing: contrasts that were not run, in words
    """

    claim: dict[str, Any]
    contrasts: list[Contrast]
    p_values: list[float]
    missing: list[str]

    @property
    def verdicts(self) -> list[str]:
        """Of each contrast."""
        pairs = zip(self.contrasts, self.p_values, strict=True)
        return [verdict(self.claim["kind"], contrast, p_value) for contrast, p_value in pairs]


def load_claims(path: Path = CLAIMS) -> list[dict[str, Any]]:
    """
    :param path: of a YAML file as claims.yml
    :raises ValueError: if a claim lacks something, or is of an unknown kind or page
    """
    claims = yaml.safe_load(path.read_text())
    for claim in claims:
        if missing := {"name", "page", "claim", "quote", "kind", "contrasts"} - set(claim):
            raise ValueError(f"a claim of {path} lacks {', '.join(sorted(missing))}: {claim}")
        if claim["kind"] not in KINDS or claim["page"] not in PAGES:
            raise ValueError(
                f"claim {claim['name']!r} of {path}: expected kind {', '.join(KINDS)} and page {', '.join(PAGES)}"
            )
    return list(claims)


def judge(study: Study, claim: dict[str, Any]) -> Judged:
    """
    :param study: finished runs
    :param claim: entry of claims.yml
    :return: the claim with its contrasts
    """
    contrasts, missing = [], []
    for a, b, levels in claim["contrasts"]:
        for level in levels:
            contrast = study.contrast(claim["kind"], level, a, b)
            if contrast is None:
                missing.append(f"{a} and {b} on {level}")
            else:
                contrasts.append(contrast)
    return Judged(claim, contrasts, corrected(contrasts), missing)


def write_pages(folder: Path) -> None:
    """
    Write README.md, a page for each part of section 4 and their figures beside the tables.

    :param folder: with curves.csv and finals.csv
    :raises FileNotFoundError: if a table is missing
    :raises ValueError: if a table lacks a column
    """
    study = read_study(folder)
    judged = [judge(study, claim) for claim in load_claims()]
    for name, title in PAGES.items():
        own = [each for each in judged if each.claim["page"] == name]
        if any(each.contrasts for each in own):
            write_text(folder / f"{name}.md", page(study, name, title, own, folder))
    write_text(folder / "README.md", overview(study, judged, folder))


def overview(study: Study, judged: Sequence[Judged], folder: Path) -> str:
    """:return: every claim with its verdict, what was run, and, with a figure, conditions that no other page tells of"""
    rows = []
    for each in judged:
        if not each.contrasts:
            continue
        held = each.verdicts.count("holds")
        run = f"{held} of {len(each.contrasts)}" + (f" ({len(each.missing)} not run)" if each.missing else "")
        link = f"[{each.claim['page']}]({each.claim['page']}.md)"
        rows.append([each.claim["claim"], f"**{verdict_of_all(each.verdicts)}**", run, link])
    left = f"{len(judged) - len(rows)} of the {len(judged)}" if rows else "all"
    not_run = f"Of {left} claims these runs say nothing."
    counts = study.finals.groupby(["level", "condition"])["seed"].nunique().unstack("level")
    runs = [[name, *(f"{n:.0f}" for n in row)] for name, row in zip(counts.index, counts.fillna(0).to_numpy(), strict=True)]
    return "\n".join(
        [
            "# Does guidance help, and what of it is language?",
            "",
            f"Claims of the paper's section 4, judged by {criteria(folder)}. Generated by `sb3-guide report` from",
            "[curves.csv](curves.csv) and [finals.csv](finals.csv).",
            "",
            *(table(["claim", "verdict", "contrasts that hold", "page"], rows) if rows else []),
            *(["", not_run] if len(rows) < len(judged) else []),
            "",
            *other_conditions(study, folder),
            f"## Runs ({len(study.finals)}): seeds of each condition",
            "",
            *table(["condition", *counts.columns], runs),
            "",
        ]
    )


def criteria(folder: Path) -> str:
    """:return: what a verdict means, in words: with a link where the criteria are beside the page"""
    if (folder / "criteria.md").is_file():
        return "[criteria](criteria.md)"
    return "the criteria of docs/results/guidance/criteria.md in sb3-guide's repository"


def other_conditions(study: Study, folder: Path) -> list[str]:
    """:return: lines on conditions that no page shows, such as those of the caller's own; their figure is drawn"""
    shown = {condition for figures in FIGURES.values() for _, _, conditions, _ in figures for condition in conditions}
    shown |= {f"{agent}-{size}" for agent in AGENTS for size in SIZES}
    others = [condition for condition in study.finals["condition"].unique() if condition not in shown]
    if not others:
        return []
    levels = [level for level in study.finals["level"].unique() if any(study.has(level, other) for other in others)]
    compared = ["learner", "guided", *others]
    draw_curves(study, levels, compared, folder / "others.png")
    picture = ["![Learner, guided Learner, and conditions of no other page](others.png)", "", "*Mean and every seed.*"]
    return ["## Other conditions", "", *picture, "", *condition_table(study, levels, compared), ""]


def page(study: Study, name: str, title: str, judged: Sequence[Judged], folder: Path) -> str:
    """:return: text of a page, whose figures are drawn"""
    lines = [f"# {title}", "", f"Generated from the tables; {criteria(folder)}, [overview](README.md).", ""]
    for file, caption, conditions, epochs in FIGURES[name]:
        levels = [level for level in LEVELS.get(name, study.levels()) if sum(study.has(level, c) for c in conditions) > 1]
        if levels:
            draw_curves(study, levels, conditions, folder / f"{file}.png", epochs)
            lines += [f"![{caption}]({file}.png)", "", f"*{caption}: mean and every seed.*", ""]
    if name == "lowdata":
        sizes = [f"{agent}-{size}" for agent in AGENTS for size in SIZES]
        levels = [level for level in study.levels() if any(study.has(level, condition) for condition in sizes)]
        draw_sizes(study, levels, AGENTS, folder / "lowdata.png")
        lines += ["![Final success over demonstrations](lowdata.png)", "", "*Cloned to the end: mean and every seed.*", ""]
    for each in judged:
        lines += claim_section(each)
    if name != "lowdata":
        conditions = list(dict.fromkeys(condition for _, _, shown, _ in FIGURES[name] for condition in shown))
        levels = LEVELS.get(name, study.levels())
        lines += ["## Every condition", "", *condition_table(study, levels, conditions), ""]
        lines += ["## What the Guide costs", "", *cost_table(study, levels, conditions), ""]
    if name == "intra":
        lines += ["## Causal influence over training (section 5.3)", "", *influence_table(study), ""]
    return "\n".join(lines)


def claim_section(judged: Judged) -> list[str]:
    """:return: lines on a claim"""
    what = "final success" if judged.claim["kind"].endswith("in-the-end") else "area"
    rows = [
        [
            contrast.level,
            f"{contrast.a} against {contrast.b}",
            str(contrast.seeds),
            "-" if contrast.horizon is None else f"{contrast.horizon:,}",
            f"{contrast.mean_a:.3f}, {contrast.mean_b:.3f}",
            f"{contrast.difference:+.3f} ({contrast.low:+.3f} to {contrast.high:+.3f})",
            p_text(p_value),
            p_text(contrast.p_exact),
            verdict(judged.claim["kind"], contrast, p_value),
        ]
        for contrast, p_value in zip(judged.contrasts, judged.p_values, strict=True)
    ]
    head = [
        "level",
        "A against B",
        "seeds",
        "horizon",
        f"{what} of A, B",
        "difference, 95 % interval",
        "p (Holm)",
        "p (exact)",
    ]
    return [
        f"## {judged.claim['claim']}: {verdict_of_all(judged.verdicts)}",
        "",
        f"> {judged.claim['quote'].strip()}",
        "",
        *(table([*head, "verdict"], rows) if rows else []),
        *(["", f"Not run: {'; '.join(judged.missing)}."] if judged.missing else []),
        "",
    ]


def condition_table(study: Study, levels: Sequence[str], conditions: Sequence[str]) -> list[str]:
    """:return: area over all of the training, episodes to each threshold and final success, with 95 % intervals over seeds"""
    rows = []
    for level in levels:
        for condition in conditions:
            if study.has(level, condition):
                curve = study.success(level, condition)
                episodes = curve.index.to_numpy()
                first = [area(episodes, curve[seed].to_numpy(), episodes[-1]) for seed in curve]
                to = [to_rate(study, level, condition, rate) for rate in THRESHOLDS]
                final = study.final(level, condition).to_numpy()
                rows.append([level, condition, str(len(final)), interval(np.array(first), ".3f"), *to, interval(final, ".3f")])
    return table(["level", "condition", "seeds", "area", *(f"to {x:.0%}" for x in THRESHOLDS), "final success"], rows)


def cost_table(study: Study, levels: Sequence[str], conditions: Sequence[str]) -> list[str]:
    """:return: episodes saved on the way to 90 %, beside the episodes that the Guide has seen"""
    known = load_catalogue().conditions
    rows = []
    for level in levels:
        for condition in conditions:
            if condition.startswith("guided") and study.has(level, condition) and study.has(level, "learner"):
                guide = Run(level, 0, condition).source(str(known[condition].guide))
                to = {name: reached(study, level, name) for name in ("learner", condition)}
                if not (seeds := sorted(to["learner"].keys() & to[condition].keys())):
                    continue
                saved = np.array([to["learner"][seed] - to[condition][seed] for seed in seeds])
                if not study.has(guide.level, guide.condition):
                    continue
                cost = study.episodes(guide.level, guide.condition)
                share = f"{cost / saved.mean():.0f}" if saved.mean() > 0 else "never"
                rows.append([level, condition, interval(saved, ",.0f"), f"{cost:,.0f}", share])
    return table(["level", "condition", "episodes saved to 90 %", "the Guide's episodes", "Learners that must share it"], rows)


def influence_table(study: Study) -> list[str]:
    """
    :return: what a guided Learner's messages cause over its training, in nats; with a frozen Guide, whose messages are as
        uncertain in the end as before, so that the bound on CIC does not move
    """
    rows = []
    for level, condition in product(study.levels(), ("guided", "frozen")):
        if study.has(level, condition):
            curves = study.curves[(study.curves["level"] == level) & (study.curves["condition"] == condition)]
            epoch = study.episodes(level, condition, 1)
            for when, episodes in (("1/4", epoch / 4), ("1", epoch), ("2", 2 * epoch), ("end", curves["episodes"].max())):
                nearest = curves.loc[(curves["episodes"] - episodes).abs().groupby(curves["seed"]).idxmin()]
                measures = [interval(nearest[name].to_numpy(), ".4f") for name in ("cic", "message_entropy", "uniform_cic")]
                rows.append([level, condition, when, str(len(nearest)), *measures])
    return table(["level", "condition", "epoch", "seeds", "CIC", "message entropy", "uniform CIC"], rows)


def reached(study: Study, level: str, condition: str) -> dict[int, float]:
    """:return: episodes to 90 % by seed"""
    curve = study.success(level, condition)
    return {seed: episodes_to(curve.index.to_numpy(), curve[seed].to_numpy(), 0.9) for seed in curve}


def to_rate(study: Study, level: str, condition: str, rate: float) -> str:
    """:return: episodes to a rate of success, and how many seeds never got there, which count with all that they have seen"""
    if not study.has(level, condition):
        return "-"
    curve = study.success(level, condition)
    episodes = np.array([episodes_to(curve.index.to_numpy(), curve[seed].to_numpy(), rate) for seed in curve])
    never = int((curve.max() < rate).sum())
    return interval(episodes, ",.0f") + (f", {never} never" if never else "")


def interval(values: np.ndarray, form: str) -> str:
    """:return: mean and, of two values or more, the bounds of its 95 % interval (Student's t)"""
    mean = values.mean()
    if len(values) < 2:
        return f"{mean:{form}}"
    half = t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return f"{mean:{form}} ± {half:{form}}"


def p_text(p_value: float) -> str:
    """:return: such as "0.012" or "< 0.001" """
    return "-" if np.isnan(p_value) else "< 0.001" if p_value < 0.001 else f"{p_value:.3f}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """:return: lines of a Markdown table"""
    return [f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows)]
