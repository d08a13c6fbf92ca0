from typing import Any

import pytest

from sb3_guide.experiments.report.findings import early_finding, influence_finding, percent, signed, training_finding
from sb3_guide.experiments.report.summary import trend


def level(*by_seed: float) -> dict[str, Any]:
    early = {"epochs": 3, "difference": sum(by_seed) / len(by_seed), "by_seed": list(by_seed)}
    return {"early": early, "learner": {"curve": [0.5] * 12}}


def influence(cic: list[float], uniform_cic: list[float], entropy: float = 3.0) -> dict[str, Any]:
    guided = {"cic": cic, "uniform_cic": uniform_cic, "message_entropy": [entropy] * len(cic)}
    return {"guided": guided, "trends": {name: trend(curve) for name, curve in guided.items()}}


def test_numbers_are_written_for_people() -> None:
    assert percent(0.9824) == "98.2\N{NO-BREAK SPACE}%"
    assert signed(-0.51, 1) == "\N{MINUS SIGN}0.5"
    assert signed(2, 1) == "+2.0"


def test_the_first_finding_names_every_agent() -> None:
    rates = {agent: {"success_rate": rate} for agent, rate in (("learner", 0.9), ("guide", 0.8), ("guided", 0.95))}
    block = {**rates, "expert": {"success_rate": 1.0, "episodes": 500}, "demos": {"episodes": 1000}}
    found = training_finding(block, "w0 w1 w2")
    for text in ("100.0\xa0%", "90.0\xa0%", "80.0\xa0%", "95.0\xa0%", "1,000", "500 fresh", "3 symbols"):
        assert text in found


@pytest.mark.parametrize(
    ("leads", "text"),
    [
        ((0.08,), "ahead of the Learner by 8.0 percentage points of success; this is a single seed, which proves nothing"),
        ((-0.021,), "behind the Learner by 2.1 percentage points"),
        ((0.0001,), "level with the Learner;"),
        (
            (0.1, -0.04),
            "ahead of the Learner by 3.0 percentage points of success: \N{MINUS SIGN}4.0 to +10.0 over 2 seeds, ahead in 1",
        ),
    ],
)
def test_the_early_lead_is_told_as_found(leads: tuple[float, ...], text: str) -> None:
    assert text in early_finding(level(*leads))
    assert "In the first 3 of 12 epochs" in early_finding(level(*leads))


@pytest.mark.parametrize(
    ("cic", "uniform_cic", "text"),
    [
        ([3.0, 2.1, 1.0], [3.0, 2.2, 1.0], "Both influences fall"),
        ([3.0, 2.1, 1.0], [1.0, 2.2, 3.0], "CIC alone falls: the Guide grows more certain"),
        ([1.0, 2.1, 3.0], [1.0, 2.2, 3.0], "Both influences rise"),
        ([1.0, 2.1, 3.0], [3.0, 2.2, 1.0], "CIC alone rises"),
    ],
)
def test_cic_is_read_together_with_uniform_cic(cic: list[float], uniform_cic: list[float], text: str) -> None:
    found = influence_finding(influence(cic, uniform_cic))
    assert text in found
    assert f"from {cic[0]:.2f} to {cic[-1]:.2f} nats" in found


@pytest.mark.parametrize(("uniform_cic", "text"), [([0.1, 0.4, 0.6], "more and more"), ([0.6, 0.4, 0.1], "less and less")])
def test_a_certain_guide_leaves_uniform_cic_alone_to_be_read(uniform_cic: list[float], text: str) -> None:
    found = influence_finding(influence([0.0006, 0.002, 0.0024], uniform_cic, entropy=0.03))
    assert "The Guide is so certain" in found
    assert text in found
    assert "from 0.0006 to 0.0024 nats" in found


def test_too_few_epochs_have_no_trend() -> None:
    assert "too few epochs for a trend" in influence_finding(influence([1.0, 2.0], [1.0, 2.0]))
