"""
Section 5 of the paper on all agents of a study: obedience at the epoch of highest CIC and at the end, what each intervention
costs, how the languages are built, whether agents of other seeds speak the same one, and causal influence over training.

    sb3-guide reproduce --study language --out runs/language
    python -m benchmarks.language runs/language --out docs/results/language

Words are learned on missions of the validation split, everything else is measured on those of the analysis split. Writes a CSV
file for each of these, README.md with tables of them, and influence.png. Runs that the folder holds already stay, unless they
are measured again.
"""

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer
from matplotlib.figure import Figure
from scipy.stats import ttest_1samp
from tqdm import tqdm

from sb3_guide import load_expert
from sb3_guide.cloning import Episodes, mission_seeds, play
from sb3_guide.envs import ACTIONS
from sb3_guide.experiments.stages.clone import HIGHEST_CIC
from sb3_guide.experiments.stages.runs import use_threads, write_table
from sb3_guide.experiments.stages.statistics import paired_successes
from sb3_guide.files import write_text
from sb3_guide.language import Reading, ablate, ablations, obey, overhear, read, read_along
from sb3_guide.language.analysis import structure
from sb3_guide.language.pictures import save_figure
from sb3_guide.metrics import agreement, by_chance, interval, joint_counts, obedience, p_value
from sb3_guide.policies import AgentPolicy, load_agent

EPISODES = 500
WORLDS = 50  # ten messages each
PERMUTATIONS = 200
LEVELS = ("GoToObj", "GoToLocal", "GoToObjMaze", "PickupLoc", "PutNextLocal")
PAPER = {"GoToObj": "76 %", "GoToLocal": "72 %"}
INFLUENCE = {
    "cic": "CIC",
    "message_entropy": "message entropy",
    "tempered_cic": "CIC at half the entropy",
    "uniform_cic": "uniform CIC",
}
TABLES = ("obedience", "ablations", "structure", "agreement", "influence")
Rows = dict[str, list[dict[str, Any]]]  # by table


def measure(runs: Path, level: str) -> Rows:
    """:return: what is found of all agents of a level"""
    found: Rows = {name: [] for name in TABLES}
    episodes = play(load_expert(level).policy, level, mission_seeds("analysis", EPISODES))
    along: dict[str, dict[int, Reading]] = {"guide": {}, "guided": {}}
    for folder in tqdm(sorted((runs / level).glob("seed*/*/agent.json")), desc=level):
        agent, seed = folder.parent.name, int(folder.parent.parent.name.removeprefix("seed"))
        key = {"level": level, "seed": seed, "agent": agent}
        if agent != "guide":
            found["influence"] += influence_rows(folder.parent, key)
        if agent in along:
            policy = load_agent(folder.parent)
            along[agent][seed] = read_along(policy, level, episodes)
            reading = read(policy, level, mission_seeds("validation", EPISODES))
            found["ablations"] += ablation_rows(policy, reading, key)
            found["structure"] += structure_rows(policy, key)
        if agent == "guided":
            best = load_agent(folder.parent / HIGHEST_CIC)
            found["obedience"] += obedience_rows(best, key | {"agent_of": "highest CIC"})
            found["obedience"] += obedience_rows(policy, key | {"agent_of": "end"})
    for agent, readings in along.items():
        found["agreement"] += agreement_rows(readings, episodes, {"level": level, "agent": agent})
    return found


def obedience_rows(policy: AgentPolicy, key: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """:return: one row for all actions together and one for each action that a message means"""
    dictionary = overhear(policy, key["level"], mission_seeds("validation", EPISODES))
    if (dictionary.meanings < 0).all():
        return
    rng, seeds = np.random.default_rng(key["seed"]), mission_seeds("analysis", WORLDS)
    meant, taken = obey(policy, key["level"], dictionary, seeds, rng)
    raw, corrected = obedience(meant, taken)
    yield key | {"action": "all", "messages": len(meant), "obeyed": raw, "beyond_chance": corrected}
    for action in np.unique(meant):
        told = meant == action
        yield key | {"action": ACTIONS[action], "messages": int(told.sum()), "obeyed": float((taken[told] == action).mean())}


def ablation_rows(policy: AgentPolicy, reading: Reading, key: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """:return: a row for each intervention"""
    successes = ablate(policy, key["level"], mission_seeds("analysis", EPISODES), ablations(reading))
    for name, outcome in successes.items():
        yield key | {
            "intervention": name,
            "success_rate": float(outcome.mean()),
            **paired_successes(outcome, successes["spoken"]),
        }


def structure_rows(policy: AgentPolicy, key: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """:return: a row for each measure of how the language is built"""
    for name, values in structure(read(policy, key["level"], mission_seeds("analysis", EPISODES))).items():
        yield key | {"measure": name, **values}


def agreement_rows(readings: dict[int, Reading], episodes: Episodes, key: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """
    :param readings: of agents by seed, along the same demonstrations
    :param episodes: those demonstrations
    :return: a row for each two agents; "within_action" is what chance gives where messages are only shuffled among frames in
        which the expert did the same, so that two agents agree by naming its actions alone
    """
    for (first, one), (second, other) in combinations(sorted(readings.items()), 2):
        count, actions = one.shape.count, episodes.actions.astype(np.int64)
        both = joint_counts(one.episode * count + one.messages, other.messages, len(episodes) * count, count)
        counts = both.reshape(len(episodes), count, count)

        def agreed(order: np.ndarray, one: Reading = one, other: Reading = other, count: int = count) -> float:
            return agreement(joint_counts(one.messages, other.messages[order], count, count))

        def resampled(often: np.ndarray, counts: np.ndarray = counts) -> float:
            return agreement(np.tensordot(often, counts, axes=1))

        observed = agreement(counts.sum(axis=0))
        low, high = interval(resampled, len(episodes), np.random.default_rng(0))
        anywhere = by_chance(agreed, np.zeros_like(actions), np.random.default_rng(0), PERMUTATIONS)
        within = by_chance(agreed, actions, np.random.default_rng(0), PERMUTATIONS)
        yield key | {
            **{"seed": first, "other_seed": second, "agreement": observed, "low": float(low), "high": float(high)},
            **{"by_chance": float(anywhere.mean()), "p_value": p_value(observed, anywhere)},
            **{"within_action": float(within.mean()), "p_value_within_action": p_value(observed, within)},
        }


def influence_rows(folder: Path, key: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """:return: a row for each validation of the training"""
    for row in pd.read_csv(folder / "progress.csv").to_dict("records"):
        yield key | {"epoch": row["epoch"], "success_rate": row["success_rate"], **{name: row[name] for name in INFLUENCE}}


def merge(path: Path, rows: list[dict[str, Any]]) -> pd.DataFrame:
    """
    :param path: of the CSV file
    :param rows: that are new, and take the place of those of the same level, agent and seed
    :return: all that the file holds from now on
    """
    table = pd.DataFrame(rows)
    if path.is_file():
        before, key = pd.read_csv(path), ["level", "agent", "seed"]
        if rows:
            again = before.set_index(key).index.isin(table.set_index(key).index)
            table = pd.concat([before[~again], table])
        else:
            table = before
    if not table.empty:
        table = table.sort_values(["level", "agent", "seed"], kind="stable")
        write_table(path, [{name: value for name, value in row.items() if value == value} for row in table.to_dict("records")])
    return table


def spread(values: pd.Series, form: str = ".1f") -> str:
    """:return: mean over agents, and of two or more the lowest and the highest; of how many, where it is not known of all"""
    known = values.dropna()
    if known.empty:
        return "-"
    ends = f" ({known.min():{form}} to {known.max():{form}})" if len(known) > 1 else ""
    return f"{known.mean():{form}}{ends}" + (f", {len(known)} of {len(values)}" if len(known) < len(values) else "")


def obedience_table(spoken: pd.DataFrame) -> Iterator[str]:
    """:return: lines of Markdown"""
    yield from (
        "## Obedience of guided Learners",
        "",
        f"{10 * WORLDS} random messages that mean something, each equally probable, greedy actions, in per cent; beyond",
        "chance: corrected for the commonest action, which can't be done for agents that only ever took one, so it is told",
        "of how many it could. Mean over seeds, lowest and highest.",
        "",
        "| level | agent of | seeds | obeyed | beyond chance | paper | by action (agents with a word for it) |",
        "|---|---|---|---|---|---|---|",
    )
    for level in LEVELS:
        for when in ("highest CIC", "end"):
            rows = spoken[(spoken["level"] == level) & (spoken["agent_of"] == when)]
            whole = rows[rows["action"] == "all"]
            if whole.empty:
                continue
            by_action = rows[rows["action"] != "all"].groupby("action")["obeyed"]
            words = ", ".join(f"{action} {values.mean():.0%} ({len(values)})" for action, values in by_action)
            rates = [spread(100 * whole[name]) for name in ("obeyed", "beyond_chance")]
            cells = (level, when, str(len(whole)), *rates, PAPER.get(level, "-"), words)
            yield f"| {' | '.join(cells)} |"


def ablation_table(cut: pd.DataFrame) -> Iterator[str]:
    """:return: lines of Markdown"""
    interventions = list(dict.fromkeys(cut["intervention"]))
    yield from ("", "## Success with each intervention", "", "In per cent: mean over seeds, lowest and highest.", "")
    yield from (f"| level | agent | seeds | {' | '.join(interventions)} |", "|---" * (3 + len(interventions)) + "|")
    for (level, agent), rows in groups(cut):
        rates = [spread(100 * rows[rows["intervention"] == name]["success_rate"]) for name in interventions]
        yield f"| {' | '.join([level, agent, str(rows['seed'].nunique()), *rates])} |"
    changed = cut[cut["intervention"] != "spoken"]
    lower = changed[(changed["p_value"] < 0.05 / len(changed)) & (changed["difference"] < 0)]
    yield from (
        "",
        f"Each agent with each intervention against the same agent as spoken, on {EPISODES} paired missions: success is",
        f"lower in {len(lower)} of {len(changed)} (McNemar's exact test at 0.05 / {len(changed)}, after Bonferroni).",
    )


def structure_table(built: pd.DataFrame) -> Iterator[str]:
    """:return: lines of Markdown"""
    yield from (
        "",
        "## How the languages are built",
        "",
        "Topographic similarity and positional disentanglement of messages with respect to where the target is (column",
        f"and row in the view) and what it is (type and colour), on one frame of each of {EPISODES} episodes. Mean over",
        "seeds, lowest and highest; by chance: the mean where messages are shuffled; agents above chance at p < 0.05",
        "(one-sided, a thousand permutations). The intervals of each agent, over episodes, are in",
        "[structure.csv](structure.csv).",
        "",
        "| level | agent | seeds | measure | value | by chance | above chance |",
        "|---|---|---|---|---|---|---|",
    )
    for (level, agent), rows in groups(built):
        for name, values in rows.groupby("measure", sort=False):
            above, title = int((values["p_value"] < 0.05).sum()), str(name).replace("_", " ")
            numbers = spread(values["value"], ".3f"), f"{values['by_chance'].mean().round(3) + 0.0:.3f}"
            cells = (level, agent, str(len(values)), title, *numbers)
            yield f"| {' | '.join(cells)} | {above} of {len(values)} |"


def agreement_table(shared: pd.DataFrame) -> Iterator[str]:
    """:return: lines of Markdown"""
    yield from (
        "",
        "## Do agents of other seeds speak the same language?",
        "",
        f"Share of the frames of {EPISODES} expert episodes in which two agents say the same, once their words are matched",
        "in the best way, in per cent: mean over pairs of seeds, lowest and highest. By chance: messages shuffled among all",
        "frames, or only among those in which the expert did the same, which leaves two agents what they share by naming",
        "its actions.",
        "",
        "| level | agent | pairs | agreement | by chance | by chance within actions | pairs above that |",
        "|---|---|---|---|---|---|---|",
    )
    for (level, agent), rows in groups(shared):
        above = int((rows["p_value_within_action"] < 0.05).sum())
        cells = [spread(100 * rows[name]) for name in ("agreement", "by_chance", "within_action")]
        yield f"| {' | '.join([level, agent, str(len(rows)), *cells])} | {above} of {len(rows)} |"


def influence_table(curves: pd.DataFrame) -> Iterator[str]:
    """:return: lines of Markdown"""
    yield from (
        "",
        "## Causal influence over training",
        "",
        "In nats, along demonstrations. CIC is bounded by the entropy of the messages, so it tells whether a Guide is",
        "listened to less and less only where that entropy stays the same: with a frozen Guide, by construction; with one",
        "that is trained along, at the one temperature of each epoch that makes its messages half as uncertain as can be.",
        "Means over seeds; the trend is the slope from the first epoch on, with the lowest and the highest of the seeds, and",
        "p, of three seeds or more, that of no trend (Student's t over seeds).",
        "",
        "![Influence by epoch, a line a seed](influence.png)",
        "",
        "| level | agent | seeds | measure | epoch 1 | end | trend an epoch | p |",
        "|---|---|---|---|---|---|---|---|",
    )
    for (level, agent), rows in groups(curves):
        for name, title in INFLUENCE.items():
            by_seed = [part for _, part in rows[rows["epoch"] >= 1].groupby("seed")]
            ends = [np.mean([part[name].iloc[at] for part in by_seed]) for at in (0, -1)]
            slopes = pd.Series([np.polyfit(part["epoch"], part[name], 1)[0] for part in by_seed]).round(6) + 0.0
            p = f"{ttest_1samp(slopes, 0).pvalue:.2g}" if len(slopes) > 2 and slopes.any() else "-"
            numbers = f"{ends[0]:.4f}", f"{ends[1]:.4f}", spread(slopes, "+.4f"), p
            cells = (level, agent, str(len(by_seed)), title, *numbers)
            yield f"| {' | '.join(cells)} |"


def groups(table: pd.DataFrame) -> Iterator[tuple[tuple[str, str], pd.DataFrame]]:
    """:return: the rows of each level and agent, in the order of LEVELS"""
    for level in LEVELS:
        for agent, rows in table[table["level"] == level].groupby("agent"):
            yield (level, str(agent)), rows


def draw(curves: pd.DataFrame) -> Figure:
    """:return: a column for each level and agent, a row for each measure, a line for each seed"""
    columns = list(groups(curves))
    figure = Figure(figsize=(2.6 * len(columns), 1.9 * len(INFLUENCE)), layout="constrained")
    panels = figure.subplots(len(INFLUENCE), len(columns), sharex="col", sharey="row", squeeze=False)
    for column, ((level, agent), rows) in enumerate(columns):
        panels[0, column].set_title(f"{level}, {agent}", fontsize=9, loc="left")
        panels[-1, column].set_xlabel("epoch", fontsize=8)
        for panel, (name, title) in zip(panels[:, column], INFLUENCE.items(), strict=True):
            for _, part in rows.groupby("seed"):
                panel.plot(part["epoch"], part[name], color="#0072b2", linewidth=1, alpha=0.7)
            panel.spines[["top", "right"]].set_visible(False)
            panel.tick_params(labelsize=8)
            if column == 0:
                panel.set_ylabel(title, fontsize=8)
    for panel in panels[:, 0]:
        panel.set_ylim(bottom=0)
    return figure


def page(tables: dict[str, pd.DataFrame]) -> str:
    """:return: all tables in Markdown"""
    makers = dict(
        zip(TABLES, (obedience_table, ablation_table, structure_table, agreement_table, influence_table), strict=True)
    )
    files = ", ".join(f"[{name}.csv]({name}.csv)" for name in TABLES)
    lines = [
        "# Languages read, and spoken",
        "",
        "Generated by `python -m benchmarks.language`; the numbers of each seed are in",
    ]
    lines += [f"{files}.", ""]
    return "\n".join([*lines, *(line for name in TABLES if not tables[name].empty for line in makers[name](tables[name])), ""])


def main(
    runs: Annotated[Path, typer.Argument(help="Folder of the study.")],
    out: Annotated[Path, typer.Option(help="Folder of the tables.")],
) -> None:
    """Measure every finished agent of the study."""
    use_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    found: Rows = {name: [] for name in TABLES}
    for level in LEVELS:
        for name, rows in measure(runs, level).items() if (runs / level).is_dir() else ():
            found[name] += rows
    tables = {name: merge(out / f"{name}.csv", rows) for name, rows in found.items()}
    write_text(out / "README.md", page(tables))
    save_figure(draw(tables["influence"]), out / "influence.png")


if __name__ == "__main__":
    typer.run(main)
