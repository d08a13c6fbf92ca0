"""Learning curves of a study, laid out as the paper's figures 4 to 6: a panel a level, a colour a condition, a line a seed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, PercentFormatter

from sb3_guide.experiments.report.study import Study, in_words
from sb3_guide.language.pictures import save_figure

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c6d31", "#999999")  # Okabe and Ito
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
}
PANELS_A_ROW = 3
SIZES = (100, 300, 1000, 3000, 10000)  # demonstrations
PANEL = (3.4, 2.6)  # inches


def draw_curves(study: Study, levels: Sequence[str], conditions: Sequence[str], path: Path, epochs: int | None = None) -> None:
    """
    :param study: to be shown
    :param levels: a panel each
    :param conditions: a colour each; those that a level lacks are left out
    :param path: of the PNG, written atomically
    :param epochs: to show; None shows all of them
    """
    columns = min(len(levels), PANELS_A_ROW)
    rows = -(-len(levels) // PANELS_A_ROW)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(PANEL[0] * columns, PANEL[1] * rows + 0.5), layout="constrained")
        panels = list(figure.subplots(rows, columns, squeeze=False, sharey=True).flat)
        for axes, level in zip(panels, levels, strict=False):
            draw_level(axes, study, level, conditions, epochs)
        for axes in panels[len(levels) :]:
            axes.set_axis_off()
        finish(figure, conditions, max(2, 2 * columns - 1), path)


def draw_sizes(study: Study, levels: Sequence[str], agents: Sequence[str], path: Path) -> None:
    """
    Final success over the number of demonstrations, from conditions such as "guided-300".

    :param study: to be shown
    :param levels: a panel each
    :param agents: a colour each
    :param path: of the PNG, written atomically
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(PANEL[0] * len(levels), PANEL[1] + 0.5), layout="constrained")
        for axes, level in zip(figure.subplots(1, len(levels), squeeze=False, sharey=True)[0], levels, strict=True):
            for colour, agent in zip(COLOURS, agents, strict=False):
                found = {size: study.final(level, f"{agent}-{size}") for size in SIZES if study.has(level, f"{agent}-{size}")}
                for size, rates in found.items():
                    axes.plot([size] * len(rates), rates, ".", color=colour, alpha=0.35)
                axes.plot(list(found), [rates.mean() for rates in found.values()], color=colour, linewidth=2, label=agent)
            axes.set_title(level)
            axes.set_xscale("log")
            axes.set_ylim(0, 1.02)
            axes.yaxis.set_major_formatter(PercentFormatter(1))
            axes.set_xlabel("demonstrations")
            axes.set_ylabel("fresh missions solved in the end")
        finish(figure, agents, len(agents), path)


def finish(figure: Figure, names: Sequence[str], columns: int, path: Path) -> None:
    """Write a figure with a legend below, of those names that are shown."""
    lines = {str(line.get_label()): line for axes in figure.axes for line in axes.get_lines()}
    shown = [name for name in names if name in lines]
    figure.legend(
        [lines[name] for name in shown], shown, loc="outside lower center", ncols=min(len(shown), columns), frameon=False
    )
    save_figure(figure, path)


def draw_level(axes: Axes, study: Study, level: str, conditions: Sequence[str], epochs: int | None) -> None:
    """Draw mean and seeds of each condition."""
    present = [condition for condition in conditions if study.has(level, condition)]
    for condition in present:
        curve, colour = study.success(level, condition), COLOURS[conditions.index(condition) % len(COLOURS)]
        axes.plot(curve.index, curve, color=colour, linewidth=0.6, alpha=0.35)
        axes.plot(curve.index, curve.mean(axis=1), color=colour, linewidth=2, label=condition)
    seeds = [len(study.final(level, condition)) for condition in present]
    axes.set_title(f"{level}, {in_words(seeds)}")
    axes.set_xlim(0, max(study.episodes(level, condition, epochs) for condition in present))
    axes.set_ylim(0, 1.02)
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / 1000:g}k"))
    axes.set_xlabel("training episodes seen")
    axes.set_ylabel("validation missions solved")
