"""From runs to tables, and from tables to pages."""

import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from sb3_guide.experiments.report.guidance import load_claims, write_pages
from sb3_guide.experiments.report.tables import control, write_tables
from sb3_guide.experiments.workflow.conditions import load_catalogue

EPISODES = np.array([0, 500, 1000, 2000, 4000])
INFLUENCE, MEASURES = np.array([0.0, 0.01, 0.02, 0.03, 0.04]), ("cic", "message_entropy", "uniform_cic")
SPEED = {"learner": 1000, "guided": 200, "guide": 2000, "silent": 1000, "transfer": 100, "guided-by-GoToLocal": 200}


def write_study(folder: Path, levels: list[str], conditions: list[str], seeds: int) -> None:
    rng, curves, finals = np.random.default_rng(0), [], []
    for level in levels:
        for condition in conditions:
            for seed in range(seeds):
                key = {"level": level, "condition": condition, "seed": seed}
                success = 1 - np.exp(-EPISODES / SPEED[condition]) - 0.01 * rng.random(5) * (EPISODES > 0)
                points = zip(EPISODES, success, INFLUENCE, strict=True)
                curves += [key | {"episodes": n, "success_rate": rate} | dict.fromkeys(MEASURES, x) for n, rate, x in points]
                finals.append(key | {"train_episodes": 1000, "n_epochs": 4, "success_rate": 0.98 + 0.001 * rng.random()})
    folder.mkdir(exist_ok=True)
    pd.DataFrame(curves).to_csv(folder / "curves.csv", index=False)
    pd.DataFrame(finals).to_csv(folder / "finals.csv", index=False)


def test_pages_of_a_study_that_is_not_complete(tmp_path: Path) -> None:
    write_study(tmp_path, ["GoToLocal", "PickupLoc"], list(SPEED), seeds=4)
    write_pages(tmp_path)
    overview, intra, curriculum = ((tmp_path / f"{name}.md").read_text() for name in ("README", "intra", "curriculum"))
    assert (
        "| Guided Learners learn faster than Learners alone | **holds** | 2 of 2 (3 not run) | [intra](intra.md) |" in overview
    )
    assert "## It takes language, not just the knowledge in the Guide's weights: does not hold" in intra
    assert "## A channel on which nothing is said costs nothing (a check of the set-up): holds" in intra
    assert "Not run: guided and learner on GoToObj;" in intra
    after_1000_episodes = " | ".join(["0.0200 ± 0.0000"] * 3)
    assert f"| GoToLocal | guided | 1 | 4 | {after_1000_episodes} |" in intra
    assert "guided-by-GoToLocal against learner | 4 |" in curriculum
    assert not (tmp_path / "lowdata.md").exists()
    assert "nan" not in overview + intra + curriculum
    for picture in ("intra", "intra-controls", "curriculum"):
        assert Image.open(tmp_path / f"{picture}.png").size[0] > 400


def test_what_a_guide_costs(tmp_path: Path) -> None:
    """To 90 %: the Learner at 4000 episodes, the guided one at 500, and the Guide has seen 4 x 1000."""
    write_study(tmp_path, ["GoToLocal"], ["learner", "guided", "guide"], seeds=3)
    write_pages(tmp_path)
    assert "| GoToLocal | guided | 3,500 ± 0 | 4,000 | 1 |" in (tmp_path / "intra.md").read_text()


def test_one_seed_makes_pages_and_no_verdict(tmp_path: Path) -> None:
    write_study(tmp_path, ["GoToObj"], ["learner", "guided"], seeds=1)
    write_pages(tmp_path)
    assert "Guided Learners learn faster than Learners alone | **is not shown**" in (tmp_path / "README.md").read_text()


def test_conditions_of_ones_own_are_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SPEED, "late", 500)
    write_study(tmp_path, ["GoToObj", "GoToLocal+PickupLoc"], ["late"], seeds=3)
    write_pages(tmp_path)
    overview = (tmp_path / "README.md").read_text()
    assert re.search(r"\| GoToObj \| late \| 3 \| 0\.\d+ ± ", overview)
    assert re.search(r"\| GoToLocal\+PickupLoc \| late \| 3 \| 0\.\d+ ± ", overview)
    assert "Of all claims these runs say nothing." in overview
    assert "criteria.md)" not in overview  # which is not there
    assert Image.open(tmp_path / "others.png").size[0] > 400


def test_a_page_of_few_sizes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("learner-1000", "guided-300"):
        monkeypatch.setitem(SPEED, name, 500)
    write_study(tmp_path, ["GoToLocal"], ["learner-1000", "guided-300"], seeds=2)
    write_pages(tmp_path)
    overview = (tmp_path / "README.md").read_text()
    links = re.findall(r"\]\((\S+)\)", overview)
    assert all((tmp_path / link).is_file() for link in links)


def test_every_claim_is_about_conditions_that_exist() -> None:
    conditions = load_catalogue().conditions
    for claim in load_claims():
        assert all({a, b} <= conditions.keys() for a, b, _ in claim["contrasts"])


def test_tables_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"curves\.csv does not exist: expected the tables of a study"):
        write_pages(tmp_path)
    write_study(tmp_path, ["GoToObj"], ["learner"], seeds=1)
    table = pd.read_csv(tmp_path / "finals.csv")
    table.drop(columns="seed").to_csv(tmp_path / "finals.csv", index=False)
    with pytest.raises(ValueError, match=r"finals\.csv lacks seed: expected the columns"):
        write_pages(tmp_path)
    table.head(0).to_csv(tmp_path / "finals.csv", index=False)
    with pytest.raises(ValueError, match=r"finals\.csv is empty: expected at least one run"):
        write_pages(tmp_path)
    (tmp_path / "finals.csv").write_text("")
    with pytest.raises(ValueError, match=r"finals\.csv is no table"):
        write_pages(tmp_path)


def test_a_claim_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "claims.yml").write_text("[{name: x, page: intra, claim: y, quote: z, kind: nicer, contrasts: []}]")
    with pytest.raises(ValueError, match=r"claim 'x' of .*: expected kind faster, as-good"):
        load_claims(tmp_path / "claims.yml")


def test_runs_are_merged_and_those_of_other_machines_stay(finished_run: Path, tmp_path: Path) -> None:
    write_tables(finished_run, tmp_path)
    curves, finals = (pd.read_csv(tmp_path / f"{name}.csv") for name in ("curves", "finals"))
    assert len(finals) == 2 * 2 * 3
    assert curves.groupby(["level", "condition", "seed"]).size().eq(14).all()
    elsewhere = finals.assign(seed=finals["seed"] + 5)
    pd.concat([elsewhere, finals.assign(successes=0)]).to_csv(tmp_path / "finals.csv", index=False)
    write_tables(finished_run, tmp_path)
    merged = pd.read_csv(tmp_path / "finals.csv")
    assert len(merged) == 24
    assert merged[merged["seed"] < 2]["successes"].gt(0).all()


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, ""),
        ({"guide": "untrained"}, "untrained"),
        ({"guide": "GoToObj/seed3/guide", "freeze_guide": True}, "Guide of GoToObj, frozen"),
        ({"hears": "silent"}, "silent"),
        ({"agent": "guide", "guide": None}, ""),
    ],
)
def test_what_makes_a_control(changes: dict[str, object], expected: str) -> None:
    plain = {"agent": "guided", "guide": "GoToLocal/seed3/guide", "freeze_guide": False, "hears": "spoken"}
    assert control({**plain, **changes}, "GoToLocal") == expected


def test_a_run_that_has_not_ended_is_no_finished_one(finished_run: Path, tmp_path: Path) -> None:
    shutil.copytree(finished_run, tmp_path / "runs")
    (tmp_path / "runs" / "GoToObj" / "seed0" / "learner" / "run.json").unlink()
    write_tables(tmp_path / "runs", tmp_path / "out")
    assert len(pd.read_csv(tmp_path / "out" / "finals.csv")) == 2 * 2 * 3 - 1


def test_a_folder_without_runs(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds no finished run"):
        write_tables(tmp_path, tmp_path / "out")
