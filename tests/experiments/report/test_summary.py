import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sb3_guide.experiments.report.summary import early_lead, over_seeds, summarise, trend
from sb3_guide.experiments.report.tables import write_tables


@pytest.fixture(scope="module")
def block(finished_run: Path) -> dict[str, Any]:
    return summarise(finished_run, ["GoToObj"], seeds=2, wall_seconds=100.0)


def runs(*curves: tuple[list[float], list[float]]) -> list[dict[str, Any]]:
    return [{"guided": {"curve": guided}, "learner": {"curve": learner}} for guided, learner in curves]


def test_one_level_is_the_summary_itself(block: dict[str, Any]) -> None:
    assert block["level"] == "GoToObj"
    assert block["seeds"] == [0, 1]
    assert block["wall_seconds"] == 100.0
    assert block["demos"] == {"episodes": 1000, "frames": 5000, "mean_length": 5.0}
    assert 0.9 < block["expert"]["success_rate"] <= 1


@pytest.mark.parametrize("content", ["{}", "[]", '{"success_rate": 1', '{"success_rate": null, "episodes": "many"}'])
def test_a_damaged_result_is_named(content: str, finished_run: Path, tmp_path: Path) -> None:
    shutil.copytree(finished_run, tmp_path / "run")
    (tmp_path / "run" / "GoToObj" / "seed0" / "guide" / "evaluation.json").write_text(content)
    with pytest.raises(ValueError, match="run holds a damaged result"):
        summarise(tmp_path / "run", ["GoToObj"], seeds=2, wall_seconds=100.0)
    with pytest.raises(ValueError, match="run holds a damaged result"):
        write_tables(tmp_path / "run", tmp_path)


def test_several_levels_have_a_block_each(finished_run: Path, block: dict[str, Any]) -> None:
    summary = summarise(finished_run, ["GoToObj", "GoToLocal"], seeds=2, wall_seconds=100.0)
    assert set(summary) == {"levels", "wall_seconds"}
    assert summary["levels"]["GoToObj"] == {key: value for key, value in block.items() if key != "wall_seconds"}


def test_rates_and_curves_are_means_over_the_seeds(block: dict[str, Any]) -> None:
    first, second = (run["guided"] for run in block["runs"])
    assert block["guided"]["success_rate"] == pytest.approx((first["success_rate"] + second["success_rate"]) / 2)
    np.testing.assert_allclose(block["guided"]["cic"], np.add(first["cic"], second["cic"]) / 2)
    assert len(block["learner"]["curve"]) == len(first["curve"])
    assert "cic" not in block["learner"]


def test_the_interval_is_that_of_all_seeds_together() -> None:
    agent = {"success_rate": 0.9, "low": 0.0, "high": 1.0, "mean_length": 5.0, "episodes": 50, "successes": 45}
    together = over_seeds([agent, agent])
    assert (together["episodes"], together["successes"]) == (100, 90)
    assert together["low"] == pytest.approx(0.8256, abs=1e-4)  # Wilson's interval of 90 in 100
    assert together["high"] == pytest.approx(0.9448, abs=1e-4)


def test_the_trend_of_a_line_is_its_slope() -> None:
    line = trend([5.0, 4.5, 4.0, 3.5])
    assert line["slope"] == pytest.approx(-0.5)
    assert line["intercept"] == pytest.approx(5.5)
    assert line["p_value"] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("curve", [[1.0], [1.0, 2.0], [0.0, 0.0, 0.0, 0.0]])
def test_short_or_constant_curves_have_no_trend(curve: list[float]) -> None:
    assert trend(curve) == {"slope": None, "intercept": None, "p_value": None}


def test_the_early_lead_is_that_of_the_first_quarter() -> None:
    later = [0.0] * 3
    found = early_lead(runs(([0.5, 0.6, *later], [0.3, 0.2, *later]), ([0.2, 0.2, *later], [0.3, 0.3, *later])))
    assert found["epochs"] == 2  # of five, rounded up
    assert found["by_seed"] == pytest.approx([0.3, -0.1])
    assert found["difference"] == pytest.approx(0.1)


def test_every_stage_is_timed(block: dict[str, Any]) -> None:
    assert len(block["stage_seconds"]) == 5 + 2 * 5  # once, and for each seed
    for stage in ("expert", "demos/analysis", "seed1/guided", "seed1/learner", "seed0/analysis/guide"):
        assert block["stage_seconds"][stage] > 0


def test_the_summary_is_json(block: dict[str, Any]) -> None:
    assert json.loads(json.dumps(block, allow_nan=False)) == block


def test_a_missing_result_is_named(finished_run: Path) -> None:
    with pytest.raises(FileNotFoundError, match="seed2"):
        summarise(finished_run, ["GoToObj"], seeds=3, wall_seconds=0.0)
