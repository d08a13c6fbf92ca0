"""From the tables of runs with several channels to their page."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from sb3_guide.experiments.report.channel import channels, write_page
from sb3_guide.experiments.report.study import read_study

EPISODES = np.array([0, 1000, 2000, 4000])  # an epoch is 2000
SHAPES = {"1x2": (1, 2), "2x3": (2, 3), "2x9": (2, 9), "3x9": (3, 9)}


def write_study(folder: Path, seeds: int) -> None:
    """Learners that succeed in half of the missions from episode 2000 on, and guided ones in all, from 1000 on."""
    curves: list[dict[str, Any]] = []
    finals: list[dict[str, Any]] = []

    def add(condition: str, success: list[float], seed: int, **more: object) -> None:
        key = {"level": "GoToLocal", "condition": condition, "seed": seed}
        measures = dict.fromkeys(("cic", "message_entropy", "uniform_cic"), 0.0)
        points = zip(EPISODES, success, strict=True)
        curves.extend(key | measures | {"episodes": n, "success_rate": rate} for n, rate in points)
        finals.append(
            key | {"train_episodes": 2000, "n_epochs": 2, "success_rate": success[-1] - 0.01 * seed, "control": None, **more}
        )

    for seed in range(seeds):
        add("learner", [0, 0, 0.5, 0.5], seed, agent="learner")
        for place, (name, (length, size)) in enumerate(SHAPES.items()):
            form = {"channel": "discrete", "message_length": length, "vocabulary_size": size}
            spoken = {"messages_used": 2 + place, "usage_entropy": np.log(2 + place), "words": 2, "actions_meant": 1}
            obeyed = {"obeyed": 0.75, "beyond_chance": 0.5 if place else None}
            add(f"guide-{name}", [0, 0, 0, 0.2 * place], seed, agent="guide", **form, **spoken, **obeyed)
            add(f"guided-{name}", [0, 1, 1, 1], seed, agent="guided", guide=f"guide-{name}", **form, **spoken, **obeyed)
        form = {"channel": "continuous", "message_length": 2, "vocabulary_size": 3}
        add("guide-continuous", [0, 0, 0, 0.9], seed, agent="guide", **form)
        add("guided-continuous", [0, 1, 1, 1], seed, agent="guided", guide="guide-continuous", **form)
    pd.DataFrame(curves).to_csv(folder / "curves.csv", index=False)
    pd.DataFrame(finals).to_csv(folder / "finals.csv", index=False)


def test_a_page_of_two_seeds(tmp_path: Path) -> None:
    """By hand: the area of 0, 0, 0.5 is 1/8, that of 0, 1, 1 is 3/4; 1000 episodes to 90 % for one, never for the other."""
    write_study(tmp_path, seeds=2)
    write_page(tmp_path)
    text = (tmp_path / "README.md").read_text()
    assert "Run so far: GoToLocal, 5 channels with 2 seeds each." in text
    assert "| Learner alone | - | 2 | - | - | 0.125 ± 0.000 | - | 4,000 ± 0, 2 never | 0.495 ± 0.064 |" in text
    speed = "0.750 ± 0.000 | 0.625 ± 0.000 | 1,000 ± 0 | 0.995 ± 0.064"
    assert f"| 3 x 9 | 729 | 2 | 0.595 ± 0.064 | 4,000 ± 0, 2 never | {speed} |" in text
    assert f"| 2 x 3, continuous | - | 2 | 0.895 ± 0.064 | 4,000 ± 0 | {speed} |" in text
    numbers = "3.0 ± 0.0 | 3.0 ± 0.0 | 2.0 ± 0.0 | 1.0 ± 0.0 | 75.0 ± 0.0"
    assert f"| 2 x 3 | guided Learner | {numbers} | 50.0 ± 0.0 |" in text
    assert "| 75.0 ± 0.0 | - |" in text  # 1 x 2, where chance is not known
    assert "| the Guide's success in the end | +1.00 (p = 0, 4 channels) |" in text
    assert "| the new Learner's area | - |" in text  # all the same
    assert "nan" not in text
    assert Image.open(tmp_path / "channel.png").size[1] > 800


def test_one_seed_has_no_intervals(tmp_path: Path) -> None:
    write_study(tmp_path, seeds=1)
    write_page(tmp_path)
    text = (tmp_path / "README.md").read_text()
    assert "5 channels with 1 seed each." in text
    assert "±" not in text


def test_a_lead_is_told_of_the_seeds_that_a_learner_has_too(tmp_path: Path) -> None:
    write_study(tmp_path, seeds=3)
    for name in ("curves", "finals"):
        table = pd.read_csv(tmp_path / f"{name}.csv")
        table[(table["condition"] != "learner") | (table["seed"] < 2)].to_csv(tmp_path / f"{name}.csv", index=False)
    write_page(tmp_path)
    assert "| 0.625 ± 0.000, 2 of 3 | 1,000 ± 0 |" in (tmp_path / "README.md").read_text()


def test_short_messages_of_few_symbols_come_first_and_those_without_last(tmp_path: Path) -> None:
    write_study(tmp_path, seeds=1)
    found = channels(read_study(tmp_path), "GoToLocal")
    assert [each.name for each in found] == ["1 x 2", "2 x 3", "2 x 9", "3 x 9", "2 x 3, continuous"]
    assert [each.possible for each in found] == [2, 9, 81, 729, None]


def test_tables_that_are_none(tmp_path: Path) -> None:
    write_study(tmp_path, seeds=1)
    table = pd.read_csv(tmp_path / "finals.csv")
    table[table["agent"] != "guided"].to_csv(tmp_path / "finals.csv", index=False)
    with pytest.raises(ValueError, match=r"finals\.csv has no guided Learner: expected at least one"):
        write_page(tmp_path)
    table.drop(columns=["channel", "words"]).to_csv(tmp_path / "finals.csv", index=False)
    with pytest.raises(ValueError, match=r"finals\.csv lacks channel, words: expected runs of a study that speaks"):
        write_page(tmp_path)


def test_learners_that_are_guided_in_another_way_are_no_channels(tmp_path: Path) -> None:
    """Those of other studies that share a folder."""
    write_study(tmp_path, seeds=2)
    finals = pd.read_csv(tmp_path / "finals.csv")
    plain = finals[finals["condition"] == "guided-2x3"]
    others = [{"condition": "late", "control": "delayed"}, {"condition": "guided-100", "train_episodes": 100}]
    pd.concat([finals, *(plain.assign(**other) for other in others)]).to_csv(tmp_path / "finals.csv", index=False)
    names = {each.guided for each in channels(read_study(tmp_path), "GoToLocal")}
    assert names == {*(f"guided-{name}" for name in SHAPES), "guided-continuous"}
