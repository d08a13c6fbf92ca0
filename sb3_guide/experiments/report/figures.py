"""Figures of the report as SVG texts, whose colours follow the page: light or dark."""

import io
import re
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator, PercentFormatter

from sb3_guide.metrics import conditional

# Stand-ins, which the SVG text replaces by the page's CSS variables. The page's colours are those of Okabe and Ito.
INK, FAINT, LEARNER, GUIDE, GUIDED, UNIFORM = "#010101", "#bbbbb2", "#0072b2", "#007d5b", "#d55e00", "#a3508a"
VARIABLES = {FAINT: "--faint", LEARNER: "--learner", GUIDE: "--guide", GUIDED: "--guided", UNIFORM: "--uniform"}
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.size": 11,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
    "grid.alpha": 0.6,
    "axes.axisbelow": True,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 10,
}
WIDTH, HEIGHT = 5.2, 3.9  # inches
PANELS_A_ROW = 3


def success_figure(level: dict[str, Any]) -> str:
    """
    Validation success of Learner and guided Learner over the epochs (paper, section "Intra-level guidance"): with one seed a
    line each and its Wilson intervals, with several the mean and a thin line a seed.

    :param level: block of the summary
    :return: SVG
    """
    with mpl.rc_context(STYLE):
        figure, (axes,) = new_figure()
        axes.axhline(level["expert"]["success_rate"], color=INK, linewidth=0.8, linestyle=(0, (1, 2)), label="expert")
        axes.axvspan(0.7, level["early"]["epochs"] + 0.3, color=FAINT, alpha=0.25, linewidth=0, label="first quarter")
        for agent, name, colour, marker in (("learner", "Learner", LEARNER, "o"), ("guided", "guided Learner", GUIDED, "s")):
            plot_curves(axes, level, agent, "curve", color=colour, marker=marker, label=name)
            if len(level["runs"]) == 1:
                run = level["runs"][0][agent]
                interval = run["curve_low"], run["curve_high"]
                axes.fill_between(epochs_of(run["curve"]), *interval, color=colour, alpha=0.18, linewidth=0)
        axes.set_ylim(0, 1.02)
        axes.yaxis.set_major_formatter(PercentFormatter(1))
        axes.set_ylabel("validation missions solved")
        axes.legend(loc="lower right")
        return to_svg(figure, f"success {level['level']}")


def influence_figure(level: dict[str, Any]) -> str:
    """
    Causal influence of communication on the guided Learner over the epochs (paper, section "Causal influence"), and what it
    must be read with: the entropy of the messages, which bounds it, and the influence of uniformly drawn messages.

    :param level: block of the summary
    :return: SVG
    """
    with mpl.rc_context(STYLE):
        figure, (upper, lower) = new_figure(rows=2)
        plot_curves(upper, level, "guided", "message_entropy", color=INK, marker="^", label="message entropy")
        plot_curves(upper, level, "guided", "cic", color=GUIDED, marker="s", label="CIC")
        trend = level["trends"]["cic"]
        if trend["slope"] is not None:
            epochs = epochs_of(level["guided"]["cic"])
            line = trend["intercept"] + trend["slope"] * epochs
            upper.plot(epochs, line, color=GUIDED, linestyle="--", linewidth=1.2, label="linear trend of CIC")
        plot_curves(lower, level, "guided", "uniform_cic", color=UNIFORM, marker="o", label="uniform CIC")
        for axes in (upper, lower):
            axes.set_ylim(bottom=0)
            axes.set_ylabel("nats")
        figure.legend(loc="outside upper left", ncols=2)
        return to_svg(figure, f"influence {level['level']}")


def plot_curves(axes: Axes, level: dict[str, Any], agent: str, curve: str, **style: Any) -> None:
    """
    :param axes: to draw in
    :param level: block of the summary
    :param agent: of the block
    :param curve: of the agent: the mean over the seeds, and a thin line a seed if there are several
    :param style: of the mean's line
    """
    runs = [run[agent][curve] for run in level["runs"]]
    for run in runs if len(runs) > 1 else []:
        axes.plot(epochs_of(run), run, color=style["color"], linewidth=0.8, alpha=0.45)
    mean = level[agent][curve]
    axes.plot(epochs_of(mean), mean, linewidth=2, markersize=4, **style)


def action_figure(analysis: dict[str, Any], messages: np.ndarray, colour: str, name: str) -> str:
    """
    P(action | message): a panel of bars for each message (paper, Figures A.1 and A.2).

    :param analysis: content of an analysis.json
    :param messages: (n,) indices of those to show
    :param colour: of the bars
    :param name: of the figure, unique in the page
    :return: SVG
    """
    counts = np.array(analysis["counts"])  # messages, actions
    probabilities = conditional(counts)
    taken = np.flatnonzero(counts.sum(axis=0))
    rows = -(-len(messages) // PANELS_A_ROW)
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        figure = Figure(figsize=(WIDTH, rows * (0.62 + 0.24 * len(taken))), layout=ConstrainedLayoutEngine(hspace=0.1))
        panels = figure.subplots(rows, PANELS_A_ROW, sharex=True, sharey=True, squeeze=False).flat
        for panel, message in zip(panels, messages, strict=False):
            use = use_of(counts[message].sum(), counts.sum())
            panel.set_title(f"{analysis['messages'][message]} · {use}", fontsize=11, loc="left")
            draw_bars(panel, probabilities[message, taken], colour)
        panels[0].set_yticks(range(len(taken)), [analysis["actions"][action] for action in taken])
        panels[0].invert_yaxis()
        for panel in panels[len(messages) :]:
            panel.set_axis_off()
        return to_svg(figure, name)


def use_of(times: int, steps: int) -> str:
    """:return: how much a message was used: its share of the steps, or how many times where that is below 1 %"""
    if times == 0:
        return "not used"
    if times >= 0.01 * steps:
        return f"{times / steps:.0%}"
    return "once" if times == 1 else f"{times} times"


def draw_bars(panel: Axes, probabilities: np.ndarray, colour: str) -> None:
    """
    :param panel: of one message
    :param probabilities: (actions,) of the actions, given the message
    :param colour: of the bars
    """
    panel.set_xlim(0, 1.35)
    panel.set_xticks([])
    panel.tick_params(left=False)
    panel.spines["bottom"].set_visible(False)
    bars = panel.barh(range(len(probabilities)), probabilities, color=colour, height=0.7)
    panel.bar_label(
        bars, [f"{probability:.0%}" if probability else "" for probability in probabilities], padding=3, fontsize=9
    )


def new_figure(rows: int = 1) -> tuple[Figure, list[Axes]]:
    """:return: a figure and its axes one above the other, with epochs below"""
    figure = Figure(figsize=(WIDTH, HEIGHT), layout="constrained")
    axes = list(figure.subplots(rows, sharex=True, squeeze=False).flat)
    axes[-1].set_xlabel("epoch")
    axes[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[-1].set_xmargin(0.03)
    return figure, axes


def epochs_of(curve: Sequence[float]) -> np.ndarray:
    """:return: numbers of the epochs that a curve has a value of"""
    return np.arange(1, len(curve) + 1)


def to_svg(figure: Figure, name: str) -> str:
    """
    :param figure: to be written
    :param name: unique in a page, as the ids inside the SVG are made of it
    :return: an svg element, the same for the same figure at any time
    """
    file = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": name, "svg.id": None}):
        figure.savefig(file, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    svg = re.sub(r"^.*?(?=<svg)", "", file.getvalue(), flags=re.DOTALL)
    svg = re.sub(r'<g id="[^"]*"', "<g", svg)  # nothing refers to groups, and their ids are the same in every figure
    for colour, variable in VARIABLES.items():
        svg = svg.replace(colour, f"var({variable}, {colour})")
    return svg.replace(INK, "currentColor")
