import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from sb3_guide.experiments.report.figures import GUIDE, action_figure, influence_figure, success_figure
from sb3_guide.experiments.report.summary import summarise


@pytest.fixture(scope="module", params=[1, 2])
def block(finished_run: Path, request: pytest.FixtureRequest) -> dict[str, Any]:
    """Of one seed and of two."""
    return summarise(finished_run, ["GoToObj"], seeds=request.param, wall_seconds=1.0)


@pytest.fixture(scope="module")
def analysis(finished_run: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((finished_run / "GoToObj/seed0/analysis/guide/analysis.json").read_text())
    return found


def test_figures_are_svg_elements_in_the_colours_of_the_page(block: dict[str, Any]) -> None:
    for figure in (success_figure(block), influence_figure(block)):
        assert ElementTree.fromstring(figure).tag == "{http://www.w3.org/2000/svg}svg"
        assert "currentColor" in figure
        assert "var(--guided, #d55e00)" in figure
    assert "var(--learner, #0072b2)" in success_figure(block)


def test_a_figure_is_the_same_at_any_time(block: dict[str, Any]) -> None:
    assert success_figure(block) == success_figure(block)


def test_figures_of_two_levels_share_no_id(block: dict[str, Any]) -> None:
    first, second = (re.findall(r' id="(.*?)"', success_figure({**block, "level": level})) for level in ("GoToObj", "GoTo"))
    assert first
    assert not set(first) & set(second)


def test_without_a_trend_no_line_is_drawn(block: dict[str, Any]) -> None:
    without = {**block, "trends": {**block["trends"], "cic": {"slope": None, "intercept": None, "p_value": None}}}
    assert "linear trend" in influence_figure(block)
    assert "linear trend" not in influence_figure(without)


def test_a_panel_for_each_message_with_its_share_of_use(analysis: dict[str, Any]) -> None:
    counts = np.array(analysis["counts"])
    figure = action_figure(analysis, np.array([0, 3, 5]), GUIDE, "test")
    assert f"w0 w0 · {counts[0].sum() / counts.sum():.0%}" in figure
    assert "w1 w0 · not used" in figure
    for times, text in ((1, "once"), (3, "3 times")):
        counts[0] = [times, 0, 0, 0, 0, 0, 0]
        assert f"w0 w0 · {text}" in action_figure({**analysis, "counts": counts.tolist()}, np.array([0]), GUIDE, "test")
    assert "w1 w1" not in figure


def test_only_actions_that_were_taken_are_named(analysis: dict[str, Any]) -> None:
    figure = action_figure(analysis, np.array([0]), GUIDE, "test")
    assert ">forward<" in figure
    assert ">toggle<" not in figure
