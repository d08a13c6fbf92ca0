"""
Does a Guide help agents that learn from reward? Learners alone, guided ones and controls by RecurrentPPO, by the criteria in
docs/results/rl_guidance/criteria.md.

    python -m benchmarks.rl_guidance --levels GoToLocal --seeds 5 --out runs/rl_guidance

Writes curves.csv and finals.csv after each training, and README.md with all that they hold and success.png at the end. What is
in finals.csv is not run again; with --seeds 0, nothing is.
"""

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
import typer
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from sb3_contrib import RecurrentPPO
from scipy.stats import gmean

from benchmarks.experts import of_expert
from sb3_guide import GuideGridVecEnv, PretrainedGuide
from sb3_guide.callbacks import StopTrainingOnSuccessRate
from sb3_guide.cloning import mission_seeds
from sb3_guide.envs import level_of
from sb3_guide.experiments.report.contrasts import Contrast, corrected, paired
from sb3_guide.experiments.stages.configs import algorithm_arguments, load_config
from sb3_guide.experiments.stages.runs import read_table, use_threads, write_table
from sb3_guide.files import write_text
from sb3_guide.language.pictures import save_figure
from sb3_guide.policies.saving import start_from
from sb3_guide.speakers import speaker_folder

CAP = {"GoToLocal": 400_000, "PickupLoc": 600_000, "PutNextLocal": 600_000}  # frames
EASIER = "GoToLocal"
EPISODES_OF = {50: 200, 90: 200, 99: 1000}  # the last ones, over which so many per cent are asked for
GREEDY_EPISODES = 500
KEY = ["level", "condition", "seed"]
SIGNIFICANT, MATTERS, EQUAL = 0.05, 0.9, 0.8


class Condition(NamedTuple):
    """
    How an agent is trained.

    :param colour: in the figure
    :param guide: "own", "easier" or "untrained": who speaks; None for a Learner alone
    :param trunk: "own" or "easier": the Guide whose trunk a Learner alone starts from
    :param policy_kwargs: besides the Guide
    """

    colour: str
    guide: str | None = None
    trunk: str | None = None
    policy_kwargs: Mapping[str, Any] = MappingProxyType({})


CONDITIONS = {
    "learner": Condition("#0072b2"),
    "guided": Condition("#d55e00", guide="own"),
    "easier": Condition("#e69f00", guide="easier"),
    "frozen": Condition("#a3508a", guide="own", policy_kwargs={"freeze_guide": True}),
    "transfer": Condition("#007d5b", trunk="own"),
    "transfer-easier": Condition("#7fb800", trunk="easier"),
    "silent": Condition("#777777", guide="own", policy_kwargs={"hears": "silent"}),
    "untrained": Condition("#56b4e9", guide="untrained"),
}
CONTRASTS = [
    *((name, "learner") for name in CONDITIONS if name != "learner"),
    *(("guided", name) for name in ("frozen", "silent", "untrained", "transfer")),
    ("easier", "transfer-easier"),
]


class Curve(StopTrainingOnSuccessRate):
    """Keep how far a training is after each rollout, and stop it at 99 % of the last 1,000 episodes."""

    def __init__(self) -> None:
        super().__init__(0.99, n_episodes=1000)
        self.rows: list[dict[str, float]] = []
        self.started = time.process_time()

    def _on_step(self) -> bool:
        goes_on = super()._on_step()
        if not goes_on:  # SB3 tells nothing of a rollout that is broken off
            self._on_rollout_end()
        return goes_on

    def _on_rollout_end(self) -> None:
        seen = list(self.successes)
        rates = {f"success_{n}": round(sum(seen[-n:]) / n, 4) for n in (200, 1000) if len(seen) >= n}
        cpu_seconds = round(time.process_time() - self.started, 2)
        self.rows.append({"frames": self.num_timesteps, "cpu_seconds": cpu_seconds, **rates})


def folder_of(guide: str, level: str) -> Path:
    """:return: of the shipped Guide, "own" or "easier" """
    return speaker_folder(EASIER if guide == "easier" else level, "guide")


def model_of(level: str, condition: Condition, seed: int) -> RecurrentPPO:
    """:return: of the condition, not yet trained; seeds are far enough apart that their worlds differ"""
    config = load_config("ppo_lstm", level)
    env = GuideGridVecEnv(level_of(level).env_id, config["n_envs"], history=0)
    arguments = algorithm_arguments(config)
    policy_kwargs = {**arguments.pop("policy_kwargs", {}), **condition.policy_kwargs, "ortho_init": False}  # all begin alike
    policy = "LearnerPolicy"
    if condition.guide == "untrained":
        policy, policy_kwargs["guide"] = "GuidedLearnerPolicy", PretrainedGuide.untrained()
    elif condition.guide is not None:
        policy, policy_kwargs["guide"] = "GuidedLearnerPolicy", folder_of(condition.guide, level)
    model = RecurrentPPO(policy, env, policy_kwargs=policy_kwargs, seed=1000 * seed, **arguments)
    if condition.trunk is not None:
        start_from(model.policy, folder_of(condition.trunk, level))
    return model


def run(level: str, name: str, seed: int) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """:return: rows of the curve, and of the end"""
    key = {"level": level, "condition": name, "seed": seed}
    model, curve = model_of(level, CONDITIONS[name], seed), Curve()
    model.learn(CAP[level], callback=curve)
    last = curve.rows[-1]
    greedy = of_expert(model.policy, level, mission_seeds("analysis", GREEDY_EPISODES), deterministic=True)
    ends = {"frames": last["frames"], "cpu_seconds": last["cpu_seconds"], "drawn": last.get("success_1000")}
    return [key | row for row in curve.rows], key | ends | reached(curve.rows) | {"greedy": greedy["success_rate"]}


def reached(rows: list[dict[str, float]]) -> dict[str, float | None]:
    """:return: frames and CPU seconds to each rate; None where it was not reached"""
    found: dict[str, float | None] = {}
    for percent, episodes in EPISODES_OF.items():
        first: dict[str, float] = next((row for row in rows if row.get(f"success_{episodes}", 0) >= percent / 100), {})
        found |= {f"frames_to_{percent}": first.get("frames"), f"cpu_to_{percent}": first.get("cpu_seconds")}
    return found


def key_of(row: Mapping[str, Any]) -> tuple[str, ...]:
    """:return: which run a row is of"""
    return tuple(str(row[name]) for name in KEY)


def add(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write rows of a run into a CSV file, in the place of what it holds of that run."""
    before = [row for row in read_table(path) if key_of(row) != key_of(rows[0])] if path.is_file() else []
    write_table(path, sorted([*before, *rows], key=key_of))


def contrasts(finals: pd.DataFrame, level: str, measure: str) -> list[Contrast]:
    """
    :param finals: of all runs
    :param measure: "frames" or "cpu": of which the logarithms of what it took to 90 % are compared
    :return: of all conditions that share seeds
    """
    runs = finals[finals["level"] == level].set_index(["condition", "seed"])
    whole = {"frames": CAP[level], "cpu": runs["cpu_seconds"]}[measure]  # stands for what was never reached
    reached = runs[f"{measure}_to_90"].unstack("condition").notna()
    took = np.log(runs[f"{measure}_to_90"].fillna(whole)).unstack("condition")
    found = []
    for a, b in CONTRASTS:
        if {a, b} <= set(took):
            both = took[[a, b]].dropna()
            contrast = paired(level, a, b, None, both[a].to_numpy(), both[b].to_numpy())
            known = reached.loc[both.index, [a, b]]
            if not known.all(axis=None):  # caps are alike, which says nothing of what they stand for
                contrast = replace(contrast, low_90=np.nan, high_90=np.nan)
            if not known.any(axis=None):
                contrast = replace(contrast, p_value=np.nan)
            elif not known[b if contrast.difference > 0 else a].all():  # the faster one's own cap makes it seem so fast
                contrast = replace(contrast, p_value=1.0)
            found.append(contrast)
    return found


def verdict(contrast: Contrast, p_value: float) -> str:
    """:return: what a contrast and its corrected p-value say, by the criteria"""
    ratio = np.exp(contrast.difference)
    if p_value < SIGNIFICANT and ratio <= MATTERS:
        return "helps"
    if p_value < SIGNIFICANT and ratio >= 1 / MATTERS:
        return "harms"
    if np.isfinite(p_value) and np.log(EQUAL) <= contrast.low_90 and contrast.high_90 <= -np.log(EQUAL):
        return "makes no difference"
    return "not shown"


def run_table(finals: pd.DataFrame, level: str) -> Iterator[str]:
    """:return: lines of Markdown: each condition's means over seeds"""
    yield "| condition | seeds | frames to 50 % | to 90 % | to 99 % | CPU seconds to 90 % | frames a second | greedy |"
    yield "|---|---|---|---|---|---|---|---|"
    for name in CONDITIONS:
        runs = finals[(finals["level"] == level) & (finals["condition"] == name)]
        if len(runs):
            took = [spread(runs[f"frames_to_{percent}"]) for percent in EPISODES_OF]
            speed = runs["frames"].sum() / runs["cpu_seconds"].sum()
            greedy = spread(runs["greedy"], ".1%", np.mean)
            yield f"| {' | '.join([name, str(len(runs)), *took, spread(runs['cpu_to_90']), f'{speed:,.0f}', greedy])} |"


def spread(values: pd.Series, form: str = ",.0f", mean: Callable[[pd.Series], float] = gmean) -> str:
    """:return: mean of what is known, lowest and highest; and of how many seeds that is, where it is not all"""
    known = values.dropna()
    if known.empty:
        return "never"
    ends = [f"{known.min():{form}} to {known.max():{form}}"] if len(known) > 1 else []
    some = [f"{len(known)} of {len(values)}"] if len(known) < len(values) else []
    about = f" ({', '.join(ends + some)})" if ends or some else ""
    return f"{mean(known):{form}}{about}"


def contrast_table(finals: pd.DataFrame, level: str) -> Iterator[str]:
    """:return: lines of Markdown: ratios of frames and of CPU seconds to 90 %"""
    yield "| contrast | seeds | frames to 90 %, ratio | p | of frames | CPU seconds to 90 %, ratio | p | of CPU seconds |"
    yield "|---|---|---|---|---|---|---|---|"
    both = [contrasts(finals, level, measure) for measure in ("frames", "cpu")]
    p_values = [corrected(of_measure) for of_measure in both]
    for pair, p_of_pair in zip(zip(*both, strict=True), zip(*p_values, strict=True), strict=True):
        cells = [f"{pair[0].a} / {pair[0].b}", str(pair[0].seeds)]
        for contrast, p_value in zip(pair, p_of_pair, strict=True):
            ratio, low, high = np.exp([contrast.difference, contrast.low, contrast.high])
            of_seeds = f" ({low:.2f} to {high:.2f})" if np.isfinite(low) else ""
            p = f"{p_value:.2g}" if np.isfinite(p_value) else "-"
            cells += [f"{ratio:.2f}{of_seeds}", p, verdict(contrast, p_value)]
        yield f"| {' | '.join(cells)} |"


def page(finals: pd.DataFrame) -> str:
    """:return: all tables in Markdown"""
    lines = [
        "# Guidance in reinforcement learning",
        "",
        "Generated by `python -m benchmarks.rl_guidance --seeds 0 --out docs/results/rl_guidance`, from",
        "[finals.csv](finals.csv) and [curves.csv](curves.csv), by the [criteria](criteria.md), which tell what each",
        "condition is. In words: [results](../../results.md#guidance-in-reinforcement-learning).",
        "",
        "Every agent trains on the level itself from the first frame on, without a curriculum, and what its Guide has",
        "cost is not counted. Success is of the last 200 episodes (99 %: 1,000), actions drawn. Geometric means over the",
        "seeds that got there, lowest and highest, and how many those are; in ratios, the cap stands for a rate that was",
        "never reached. Ratios with 95 % intervals, below 1 where the first is faster; p after Holm's correction, none",
        "where neither ever reached 90 %, and 1 where the faster one did not in every seed. Greedy: success where each",
        "training ended.",
        "",
        "In this table the Learner alone, `transfer` and `transfer-easier` started from SB3's orthogonal initialisation,",
        "and the other conditions did not. Contrasts between the two kinds are confounded with that, and will be run again.",
        "`ppo_lstm.yml` had 64 worlds, four epochs and other rates for these levels then.",
        "",
        "![Success over frames, a line a seed](success.png)",
    ]
    for level in levels_in(finals):
        lines += ["", f"## {level}", "", f"At most {CAP[level]:,} frames.", ""]
        lines += [*run_table(finals, level), "", *contrast_table(finals, level)]
    return "\n".join([*lines, ""])


def levels_in(table: pd.DataFrame) -> list[str]:
    """:return: names of those that were run, in the order of CAP"""
    return [level for level in CAP if level in set(table["level"])]


def draw(curves: pd.DataFrame) -> Figure:
    """:return: a panel for each level, a line for each seed and condition, which ends where the training did"""
    levels = levels_in(curves)
    figure = Figure(figsize=(4.6 * len(levels), 3.9), layout="constrained")
    for panel, level in zip(figure.subplots(1, len(levels), sharey=True, squeeze=False)[0], levels, strict=True):
        for name, condition in CONDITIONS.items():
            runs = curves[(curves["level"] == level) & (curves["condition"] == name)].dropna(subset="success_200")
            for number, (_, run) in enumerate(runs.groupby("seed")):
                label = None if number else name
                panel.plot(run["frames"], run["success_200"], color=condition.colour, linewidth=1, alpha=0.75, label=label)
                panel.plot(run["frames"].iloc[-1:], run["success_200"].iloc[-1:], "o", color=condition.colour, markersize=3)
        panel.set_title(level, fontsize=10, loc="left")
        panel.set_xscale("log")
        panel.set_xticks([10_000, 30_000, 100_000, 300_000], ["10,000", "30,000", "100,000", "300,000"])
        panel.set_xticks([], minor=True)
        panel.set_xlabel("frames")
        panel.set_ylim(0, 1.02)
        panel.yaxis.set_major_formatter(PercentFormatter(1))
        panel.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("of the last 200 episodes solved")
    lines = {line.get_label(): line for panel in figure.axes for line in panel.get_legend_handles_labels()[0]}
    figure.legend(handles=lines.values(), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def main(
    out: Annotated[Path, typer.Option(help="Folder of the tables.")],
    levels: Annotated[list[str] | None, typer.Option(help="Where to train; GoToLocal if left out.")] = None,
    seeds: Annotated[int, typer.Option(help="How many, from 0 on.")] = 5,
    conditions: Annotated[list[str] | None, typer.Option(help="Of what kind; all if left out.")] = None,
) -> None:
    """Run what is missing, one seed of all these conditions after the other, and write the page."""
    use_threads(1)
    if seeds:  # the engine is compiled once on a machine, which counts for no run
        model_of(EASIER, CONDITIONS["learner"], 0).learn(1)
    out.mkdir(parents=True, exist_ok=True)
    finals = out / "finals.csv"
    for level in levels or [EASIER]:
        for seed in range(seeds):
            for name in conditions or CONDITIONS:
                done = finals.is_file() and (level, name, str(seed)) in map(key_of, read_table(finals))
                if not done and not (level == EASIER and "easier" in name):
                    curve, end = run(level, name, seed)
                    add(out / "curves.csv", curve)
                    add(finals, [end])
                    print(end, flush=True)
    table = pd.read_csv(finals)
    write_text(out / "README.md", page(table))
    save_figure(draw(pd.read_csv(out / "curves.csv")), out / "success.png")


if __name__ == "__main__":
    typer.run(main)
