"""What an agent says and does, as figures laid out like the paper's 7 and A.1 to A.3."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sb3_guide.envs.rendering import TILE
from sb3_guide.files import atomically

INK, FAINT, BAR = "#22262e", "#9aa3b2", "#0072b2"


def conditional_bars(rows: list[str], columns: list[str], counts: np.ndarray, intervals: np.ndarray | None = None) -> Figure:
    """
    A panel for each row that occurs, with a bar for each column: P(column|row) and its interval.

    :param rows: names of what is given
    :param columns: names of what follows
    :param counts: (R, C)
    :param intervals: (2, R, C) bounds of the 95 % intervals, if there are any
    """
    shown = np.flatnonzero(counts.sum(axis=1) > 0)
    figure, panels = grid_of_panels(len(shown), across=3, size=(3.4, 2.3))
    for panel, row in zip(panels, shown, strict=True):
        rates = counts[row] / counts[row].sum()
        errors = None if intervals is None else np.abs(np.nan_to_num(intervals[:, row] - rates))
        panel.bar(range(len(columns)), rates, color=BAR, yerr=errors, error_kw={"ecolor": INK, "elinewidth": 0.8})
        panel.set_title(f"{rows[row]} ({counts[row].sum():,} frames)", fontsize=9, loc="left")
        panel.set_xticks(range(len(columns)), columns, rotation=60, fontsize=8)
        panel.set_ylim(0, 1.05)
        panel.spines[["top", "right"]].set_visible(False)
    return figure


def change_bars(rows: list[str], columns: list[str], before: np.ndarray, after: np.ndarray, intervals: np.ndarray) -> Figure:
    """
    A panel for each row that occurs, with two bars for each column: P(column|row) before and after. A change whose interval
    leaves out 0 is written above them.

    :param rows: names of what is given
    :param columns: names of what follows
    :param before: (R, C) counts
    :param after: (R, C) counts
    :param intervals: (2, R, C) bounds of the 95 % intervals of the change; NaN where a row hardly occurs in one of them
    """
    shown = np.flatnonzero((before + after).sum(axis=1) > 0)
    figure, panels = grid_of_panels(len(shown), across=3, size=(3.4, 2.3))
    places = np.arange(len(columns))
    for panel, row in zip(panels, shown, strict=True):
        rates = [counts[row] / max(1, counts[row].sum()) for counts in (before, after)]
        for rate, shift, colour, label in zip(rates, (-0.2, 0.2), (FAINT, BAR), ("before", "after"), strict=True):
            panel.bar(places + shift, rate, width=0.4, color=colour, label=label)
        for column in np.flatnonzero((intervals[0, row] > 0) | (intervals[1, row] < 0)).tolist():
            height = max(rate[column] for rate in rates)
            panel.text(
                column, height + 0.02, f"{rates[1][column] - rates[0][column]:+.0%}", ha="center", fontsize=8, color=INK
            )
        panel.set_title(f"{rows[row]} ({before[row].sum():,} to {after[row].sum():,} frames)", fontsize=9, loc="left")
        panel.set_xticks(places, columns, rotation=60, fontsize=8)
        panel.set_ylim(0, 1.15)
        panel.spines[["top", "right"]].set_visible(False)
    panels[0].legend(fontsize=8, frameon=False)
    return figure


def grid_of_panels(count: int, across: int, size: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    """
    :param count: panels that are needed
    :param across: at most so many in a row
    :param size: width and height of a panel, in inches
    :return: the figure and its panels, which share their axes
    """
    across = min(across, count)
    down = -(-count // across)
    figure = Figure(figsize=(size[0] * across, size[1] * down), layout="constrained")
    panels = list(figure.subplots(down, across, sharex=True, sharey=True, squeeze=False).ravel())
    for panel in panels[count:]:
        panel.set_visible(False)
    for panel in panels[:count][-across:]:
        panel.tick_params(labelbottom=True)  # nothing is beneath them that could have their labels
    return figure, panels[:count]


def view_maps(messages: list[str], counts: np.ndarray) -> Figure:
    """
    A map of the agent's view for each message that occurs: how often it is spoken with the target in each cell.

    :param messages: names
    :param counts: (7, 7, M) first across the view, then from far to near
    """
    shown = np.flatnonzero(counts.sum(axis=(0, 1)) > 0)
    figure, panels = grid_of_panels(len(shown), across=5, size=(2.1, 2.3))
    with np.errstate(invalid="ignore"):
        shares = counts / counts.sum(axis=2, keepdims=True)
    for panel, message in zip(panels, shown, strict=True):
        image = panel.imshow(shares[:, :, message].T, vmin=0, vmax=1, cmap="viridis")
        panel.plot(3, 6, marker="^", color="white", markeredgecolor=INK, markersize=9)
        panel.set_title(messages[message], fontsize=9, loc="left")
        panel.set_xticks([])
        panel.set_yticks([])
    figure.colorbar(image, ax=panels, label="P(message | target in this cell)", shrink=0.8)
    return figure


def walk_figure(grid: np.ndarray, cells: np.ndarray, told: Sequence[str]) -> Figure:
    """
    The way that an agent went when it was told what to do, over the grid where it began (paper figure 7).

    :param grid: (height, width, 3) uint8 picture of the grid
    :param cells: (T + 1, 3) column, row and direction (0 right, 1 down, 2 left, 3 up) before each message and after the last
    :param told: what it was told at each of the T steps, in words
    """
    figure = Figure(figsize=(8.4, 4.8), layout="constrained")
    axes, words = figure.subplots(1, 2, width_ratios=(3, 2))
    axes.imshow(grid)
    centres = (cells[:, :2] + 0.5) * TILE
    axes.plot(*centres.T, color="#f0a15e", linewidth=2.5, alpha=0.8)
    heading = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])[cells[:, 2]] * TILE * 0.32
    axes.quiver(
        *centres.T, *heading.T, np.arange(len(cells)), angles="xy", scale_units="xy", scale=1, cmap="autumn", width=0.008
    )
    steps = "\n".join(f"{number}. {text}" for number, text in enumerate(told, start=1))
    words.text(0, 1, steps, transform=words.transAxes, va="top", fontsize=9, color=INK)
    axes.set_axis_off()
    words.set_axis_off()
    return figure


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, the same bytes for the same figure."""
    with atomically(path) as partial:
        figure.savefig(partial, format="png", dpi=130, metadata={"Software": None})
