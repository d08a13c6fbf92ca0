"""Results page on how much language there is: messages of several forms, and channels without symbols."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from sb3_guide.experiments.report.contrasts import area
from sb3_guide.experiments.report.curves import COLOURS, STYLE
from sb3_guide.experiments.report.guidance import interval, table, to_rate
from sb3_guide.experiments.report.study import Study, in_words, read_study
from sb3_guide.files import write_text
from sb3_guide.language.pictures import save_figure

SPEECH = ("messages_used", "usage_entropy", "words", "actions_meant", "obeyed", "beyond_chance")
COLUMNS = {"agent", "guide", "control", "channel", "message_length", "vocabulary_size", *SPEECH}
RATE = 0.9  # of success, by which speed is told
FEWEST = 4  # channels that have a rank correlation
WIDTH, HEIGHT = 4.6, 1.7  # of a panel, in inches


@dataclass(frozen=True)
class Channel:
    """
    A form of messages on a level, in a Guide and in the Learners that hear it.

    :param study: finished runs
    :param level: name
    :param guide: condition of the Guide
    :param guided: condition of the Learners
    :param length: symbols in a message
    :param vocabulary_size: different symbols
    :param continuous: whether numbers stand in their place
    """

    study: Study
    level: str
    guide: str
    guided: str
    length: int
    vocabulary_size: int
    continuous: bool

    @property
    def name(self) -> str:
        """Such as "2 x 3"."""
        return f"{self.length} x {self.vocabulary_size}" + (", continuous" if self.continuous else "")

    @property
    def possible(self) -> int | None:
        """Number of different messages; None where there is no end to them."""
        return None if self.continuous else self.vocabulary_size**self.length

    def speech(self, condition: str, column: str) -> np.ndarray:
        """:return: a value for each seed of a condition that was measured, NaN where there is none"""
        rows = self.study.finals
        return rows.loc[(rows["level"] == self.level) & (rows["condition"] == condition), column].to_numpy(dtype=float)

    def areas(self) -> pd.Series:
        """:return: of the guided Learner, see :func:`areas`"""
        return areas(self.study, self.level, self.guided)

    def leads(self) -> np.ndarray:
        """:return: (seeds,) how much larger these are than the Learner's alone with the same seed, NaN where there is none"""
        own = self.areas()
        return (own - areas(self.study, self.level, "learner").reindex(own.index)).to_numpy()


def channels(study: Study, level: str) -> list[Channel]:
    """
    :return: of a level, those of symbols first, from short messages of few to long ones of many; Learners that are guided in
        another way, or by fewer demonstrations, such as those of other studies in a shared folder, have none
    """
    of_level = study.finals[(study.finals["level"] == level) & (study.finals["agent"] == "guided")]
    of_level = of_level[of_level["control"].isna() & (of_level["train_episodes"] == of_level["train_episodes"].max())]
    found = [
        Channel(study, level, row.guide, row.condition, int(row.message_length), int(row.vocabulary_size), continuous)
        for row in of_level.drop_duplicates("condition").itertuples()
        for continuous in [row.channel == "continuous"]
    ]
    return sorted(found, key=lambda channel: (channel.continuous, channel.length, channel.vocabulary_size))


def areas(study: Study, level: str, condition: str) -> pd.Series:
    """:return: mean success while learning in the first epoch, by seed"""
    if not study.has(level, condition):
        return pd.Series(dtype=float)
    curve, horizon = study.success(level, condition), study.episodes(level, condition, 1)
    return curve.apply(lambda success: area(curve.index.to_numpy(), success.to_numpy(), horizon))


def write_page(folder: Path) -> None:
    """
    Write README.md and channel.png beside the tables.

    :param folder: with curves.csv and finals.csv
    :raises FileNotFoundError: if a table is missing
    :raises ValueError: if a table lacks a column, or there is no guided Learner
    """
    study = read_study(folder)
    if missing := COLUMNS - set(study.finals.columns):
        raise ValueError(f"{folder / 'finals.csv'} lacks {', '.join(sorted(missing))}: expected runs of a study that speaks")
    levels = [level for level in study.levels() if channels(study, level)]
    if not levels:
        raise ValueError(f"{folder / 'finals.csv'} has no guided Learner: expected at least one")
    draw(study, levels, folder / "channel.png")
    write_text(folder / "README.md", page(study, levels))


def page(study: Study, levels: Sequence[str]) -> str:
    """:return: text of the page"""
    lines = [
        "# How much language?",
        "",
        "Messages of several lengths and vocabularies (2 x 3 means two symbols of three: nine messages, as in the paper), and",
        "channels without symbols, whose messages are as many numbers as the one-hot symbols of that form have. Generated by",
        "`sb3-guide report --page channel` from [curves.csv](curves.csv) and [finals.csv](finals.csv). Every number is a mean",
        "over seeds with its 95 % interval (Student's t); one seed has none, and tells little.",
        "",
        f"Run so far: {'; '.join(coverage(study, level) for level in levels)}.",
        "",
        "![Each channel: the Guide's success, the speed of a new Learner, messages in use, obedience](channel.png)",
        "",
        "*Each channel: a dot a seed, and their mean. Dashed: the Learner alone.*",
        "",
        "## What goes with the number of messages",
        "",
        "Spearman's rank correlation, over channels with symbols, of how many messages are possible with the mean of each",
        "measure; p takes the channels for independent.",
        "",
        *correlation_table(study, levels),
        "",
    ]
    for level in levels:
        lines += [
            f"## {level}",
            "",
            "Success on fresh missions, and how fast a new Learner gets there. Area: mean validation success in its first",
            f"epoch ({study.episodes(level, channels(study, level)[0].guided, 1):,} episodes). Lead: how much larger that is",
            "than the area of the Learner alone with the same seed.",
            "",
            *success_table(study, level),
            "",
            "What is said on validation missions, and how far it is obeyed when 500 random words are said instead. Effective:",
            "how many equally frequent messages would be as uncertain. Words: messages that an action follows in 80 % of the",
            "frames and more. Beyond chance: corrected for the commonest action; not known of agents that only ever took one.",
            "A Guide's actions are a function of its message, so that it obeys by construction.",
            "",
            *speech_table(study, level),
            "",
        ]
    return "\n".join(lines)


def coverage(study: Study, level: str) -> str:
    """:return: how many channels and seeds of a level the tables hold"""
    seeds = [len(study.final(level, each.guided)) for each in channels(study, level)]
    return f"{level}, {len(seeds)} channels with {in_words(seeds)} each"


def success_table(study: Study, level: str) -> list[str]:
    """:return: lines of Markdown: a row for the Learner alone, and one for each channel"""
    head = ["channel", "messages", "seeds", "Guide, in the end", f"Guide to {RATE:.0%}", "area", "lead"]
    rows = []
    if study.has(level, "learner"):
        alone = [interval(areas(study, level, "learner").to_numpy(), ".3f"), "-", to_rate(study, level, "learner", RATE)]
        final = study.final(level, "learner").to_numpy()
        rows.append(["Learner alone", "-", str(len(final)), "-", "-", *alone, interval(final, ".3f")])
    for each in channels(study, level):
        finals = {name: study.final(level, name).to_numpy() for name in (each.guide, each.guided)}
        rows.append(
            [
                each.name,
                "-" if each.possible is None else f"{each.possible:,}",
                str(len(finals[each.guided])),
                known(finals[each.guide], ".3f"),
                to_rate(study, level, each.guide, RATE),
                interval(each.areas().to_numpy(), ".3f"),
                known(each.leads(), ".3f"),
                to_rate(study, level, each.guided, RATE),
                interval(finals[each.guided], ".3f"),
            ]
        )
    return table([*head, f"episodes to {RATE:.0%}", "success in the end"], rows)


def speech_table(study: Study, level: str) -> list[str]:
    """:return: lines of Markdown: two rows for each channel with symbols, of the Guide and of the guided Learner"""
    rows = []
    for each in channels(study, level):
        for agent, condition in (("Guide", each.guide), ("guided Learner", each.guided)) if not each.continuous else ():
            used, entropy, words, meant, obeyed, beyond = (each.speech(condition, column) for column in SPEECH)
            numbers = known(used, ".1f"), known(np.exp(entropy), ".1f"), known(words, ".1f"), known(meant, ".1f")
            rows.append([each.name, agent, *numbers, known(100 * obeyed, ".1f"), known(100 * beyond, ".1f")])
    head = ["channel", "agent", "messages in use", "effective", "words", "actions they mean", "obeyed, %", "beyond chance, %"]
    return table(head, rows)


def correlation_table(study: Study, levels: Sequence[str]) -> list[str]:
    """:return: lines of Markdown: a row for each measure, a column for each level"""
    rows = []
    for title, measure in MEASURES.items():
        cells = []
        for level in levels:
            means = [(each.possible, mean_of(measure(each))) for each in channels(study, level) if not each.continuous]
            possible, values = np.array([pair for pair in means if not np.isnan(pair[1])], dtype=float).reshape(-1, 2).T
            rank = spearmanr(possible, values) if len(values) >= FEWEST and np.ptp(values) else None
            cells.append("-" if rank is None else f"{rank.statistic:+.2f} (p = {rank.pvalue:.2g}, {len(values)} channels)")
        rows.append([title, *cells])
    return table(["measure", *levels], rows)


def known(values: np.ndarray, form: str) -> str:
    """:return: mean and interval of the values that are known, and of how many where it is not all; "-" where none is"""
    numbers = values[~np.isnan(values)]
    if not len(numbers):
        return "-"
    return interval(numbers, form) + (f", {len(numbers)} of {len(values)}" if len(numbers) < len(values) else "")


def mean_of(values: np.ndarray) -> float:
    """:return: of those that are known; NaN where none is"""
    numbers = values[~np.isnan(values)]
    return float(numbers.mean()) if len(numbers) else float("nan")


MEASURES: dict[str, Callable[[Channel], np.ndarray]] = {  # a value a seed
    "the Guide's success in the end": lambda each: each.study.final(each.level, each.guide).to_numpy(),
    "the new Learner's area": lambda each: each.areas().to_numpy(),
    "effective messages of the guided Learner": lambda each: np.exp(each.speech(each.guided, "usage_entropy")),
    "obedience beyond chance": lambda each: each.speech(each.guided, "beyond_chance"),
}


def draw(study: Study, levels: Sequence[str], path: Path) -> None:
    """
    :param study: to be shown
    :param levels: a column each
    :param path: of the PNG, written atomically
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH * len(levels), HEIGHT * len(MEASURES) + 0.6), layout="constrained")
        panels = figure.subplots(len(MEASURES), len(levels), squeeze=False, sharex="col", sharey="row")
        for column, level in zip(panels.T, levels, strict=True):
            shown = channels(study, level)
            column[0].set_title(level)
            for axes, measure in zip(column, MEASURES.values(), strict=True):
                draw_panel(axes, shown, measure)
            if study.has(level, "learner"):
                column[1].axhline(areas(study, level, "learner").mean(), color="black", linewidth=0.8, linestyle="--")
            column[-1].set_xticks(range(len(shown)), [each.name for each in shown], rotation=90)
        for axes, title in zip(panels[:, 0], MEASURES, strict=True):
            axes.set_ylabel(title.replace(" of the ", "\nof the ").replace("'s ", "'s\n"))
            axes.set_ylim(bottom=min(0, axes.get_ylim()[0]))
        save_figure(figure, path)


def draw_panel(axes: Axes, shown: Sequence[Channel], measure: Callable[[Channel], np.ndarray]) -> None:
    """Draw a dot for each seed and a line for their mean, in the colour of the length, black for those without symbols."""
    for place, each in enumerate(shown):
        values, colour = measure(each), "black" if each.continuous else COLOURS[(each.length - 1) % len(COLOURS)]
        axes.plot([place] * len(values), values, ".", color=colour, alpha=0.5)
        axes.plot([place - 0.3, place + 0.3], [mean_of(values)] * 2, color=colour, linewidth=2)
