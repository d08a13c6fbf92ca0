"""Conditions and studies as data."""

import re
from pathlib import Path

import pytest
import yaml

from sb3_guide.experiments.stages.clone import AGENTS, guide_kwargs, override
from sb3_guide.experiments.stages.configs import load_config
from sb3_guide.experiments.workflow.conditions import Run, load_catalogue

PAGE = Path(__file__).parents[3] / "docs" / "conditions.md"


def write(path: Path, **content: object) -> Path:
    path.write_text(yaml.safe_dump(content))
    return path


def test_every_packaged_run_can_be_run() -> None:
    catalogue = load_catalogue()
    for study in catalogue.studies:
        runs = catalogue.runs(study, ["GoToObj"] if study == "stages" else [])
        for place, run in enumerate(runs):
            condition = catalogue.conditions[run.condition]
            assert all(run.source(reference) in runs[:place] for reference in condition.references())
            guide = "untrained" if condition.guide else None
            assert guide_kwargs(condition.agent, guide, condition.freeze_guide, condition.hears).keys() <= {
                *("guide", "freeze_guide", "hears")
            }
            assert condition.init is None or condition.agent == "learner"
    assert {condition.agent for condition in catalogue.conditions.values()} == AGENTS.keys()


def test_a_run_in_words_of_the_command_line() -> None:
    catalogue = load_catalogue()
    assert catalogue.options(Run("GoToLocal", 3, "silent")) == [
        *("--agent", "guided", "--guide", "GoToLocal/seed3/guide", "--hears", "silent")
    ]
    assert catalogue.options(Run("PickupLoc", 0, "guided-by-all")) == [
        *("--agent", "guided", "--guide", "GoToLocal+PickupLoc+PutNextLocal/seed0/guide")
    ]
    assert catalogue.options(Run("PickupLoc", 1, "pretrained-on-GoToLocal"))[2:] == ["--init", "GoToLocal/seed1/learner"]
    assert catalogue.options(Run("GoToObj", 1, "reader")) == [
        *("--agent", "guide", "--guide", "GoToObj/seed1/guide", "--freeze-guide")
    ]


def test_hyper_parameters_in_words_of_the_command_line() -> None:
    catalogue = load_catalogue()
    run = Run("GoToLocal", 0, "guide-continuous-1x2")
    assert catalogue.params(run) == [
        *("n_epochs:12", "validate_every:2"),
        'policy_kwargs:{"message_length": 1, "vocabulary_size": 2, "channel": "continuous"}',
    ]
    config = override(load_config("bc", "GoToLocal"), catalogue.params(run))
    assert config["policy_kwargs"] == {"message_length": 1, "vocabulary_size": 2, "channel": "continuous"}


def test_levels_and_seeds_select() -> None:
    runs = load_catalogue().runs("curriculum", ["GuideGrid-PickupLoc-v0"], seeds=2)
    assert {run.level for run in runs if run.condition.startswith("guided")} == {"PickupLoc"}
    assert {run.level for run in runs} == {"GoToLocal", "PickupLoc", "PutNextLocal"}  # where Guides and Learners come from
    assert {run.seed for run in runs} == {0, 1}


def test_a_study_of_ones_own(tmp_path: Path) -> None:
    late = {"agent": "guided", "guide": "guide", "hears": "delayed"}
    study = {"grids": [{"levels": ["GoToObj"], "conditions": ["late"], "seeds": 2}]}
    catalogue = load_catalogue(write(tmp_path / "mine.yml", conditions={"late": late}, studies={"mine": study}))
    assert catalogue.runs("mine") == [
        *(Run("GoToObj", 0, "guide"), Run("GoToObj", 0, "late"), Run("GoToObj", 1, "guide"), Run("GoToObj", 1, "late"))
    ]
    assert "intra" in catalogue.studies


def test_levels_may_be_written_as_ids(tmp_path: Path) -> None:
    far = {"agent": "guided", "guide": "guide@GuideGrid-GoToLocal-v0"}
    study = {"grids": [{"levels": ["GuideGrid-PickupLoc-v0"], "conditions": ["far"], "seeds": 1}]}
    catalogue = load_catalogue(write(tmp_path / "mine.yml", conditions={"far": far}, studies={"mine": study}))
    runs = [Run("GoToLocal", 0, "guide"), Run("PickupLoc", 0, "far")]
    assert catalogue.runs("mine") == catalogue.runs("mine", ["PickupLoc"]) == runs


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"conditions": {"x": {"agent": "teacher"}}}, "agent='teacher' is unknown: expected one of learner, guide, guided"),
        ({"conditions": {"x": {"agent": "learner", "guide": "guide"}}}, "a learner hears no Guide"),
        ({"conditions": {"x": {"agent": "guided"}}}, "a guided Learner needs a pretrained Guide"),
        ({"conditions": {"x": {"agent": "guide", "init": "learner"}}}, "a guide starts from nothing"),
        ({"conditions": {"x": {"agent": "guided", "guide": "learner"}}}, "needs 'learner', a learner: expected a guide"),
        ({"conditions": {"x": {"agent": "learner", "init": "guided"}}}, "needs 'guided', a guided: expected a learner or a"),
        ({"conditions": {"x": {"agent": "learner", "init": "untrained"}}}, "init is 'untrained': leave it out"),
        ({"conditions": {"x": {"agent": "guided", "guide": "guide@"}}}, "'guide@' names no level"),
        ({"conditions": {1: {"agent": "learner"}}}, "condition 1: expected a name of letters"),
        ({"studies": {"x": {"grids": [{"conditions": [], "seeds": 1}]}}}, "a grid of no conditions"),
        ({"studies": {"x": {"grids": [{"conditions": ["guide@GoTo"], "seeds": 1}]}}}, "condition 'guide@GoTo' is unknown"),
        (
            {"conditions": {"x": {"agent": "guided", "hears": "well"}}},
            "intervention 'well' is unknown: expected one of spoken",
        ),
        ({"conditions": {"x": {"agent": "guided", "guide": "tour"}}}, "condition 'tour' is unknown: expected one of learner"),
        ({"conditions": {"x": {"agent": "learner", "pupil": 1}}}, "condition x has pupil: expected some of agent, guide"),
        ({"conditions": {"x": {"guide": "guide"}}}, "condition x lacks agent"),
        ({"conditions": {"x": "learner"}}, "condition x is 'learner': expected a mapping with agent, guide"),
        ({"conditions": None}, r"conditions is None: expected dict"),
        ({"condition": {}}, "the file has condition: expected some of conditions, studies"),
        ({"studies": {"x": {"grids": {"seeds": 1}}}}, r"grids is \{'seeds': 1\}: expected list"),
        ({"studies": {"x": {"grids": ["a"]}}}, "a grid of study x is 'a': expected a mapping with conditions, seeds"),
        ({"studies": {"x": {"grids": [], "anlyze": []}}}, "study x has anlyze: expected some of grids, expert"),
        ({"studies": {"x": {"grids": [{"conditions": ["tour"], "seeds": 1}]}}}, "condition 'tour' is unknown"),
        ({"studies": {"x": {}}}, "no usable conditions and studies: study x lacks grids"),
        ({"studies": {"x": {"grids": [{"conditions": ["learner"], "seeds": 10**9}]}}}, "expected 1 to 1000"),
        (
            {"studies": {"x": {"grids": [{"conditions": "learner", "seeds": 1}]}}},
            r"conditions is 'learner': expected list\[str",
        ),
        ({"studies": {"x": {"grids": [], "expert": "wise"}}}, "expert 'wise' is unknown: expected one of trained"),
        ({"studies": {"x": {"grids": [], "page": "last"}}}, "page 'last' is unknown: expected one of guidance, channel"),
        ({"studies": {"x": {"grids": [], "speak": ["tour"]}}}, "condition 'tour' is unknown: expected one of learner"),
        ({"conditions": {"x": {"agent": ["guide"]}}}, r"agent is \['guide'\]: expected str"),
        ({"conditions": {"../x; rm -r": {"agent": "guide"}}}, "expected a name of letters, digits"),
        (
            {"conditions": {n: {"agent": "guide", "guide": of} for n, of in (("x", "y"), ("y", "x"))}},
            "wait for each other: [xy] needs [xy]",
        ),
    ],
)
def test_what_is_no_condition(content: dict[str, object], message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        load_catalogue(write(tmp_path / "mine.yml", **content))


@pytest.mark.parametrize(
    ("study", "levels", "seeds", "message"),
    [
        ("extra", [], None, "study 'extra' is unknown: expected one of stages, intra"),
        ("intra", [], 0, "The number of seeds is 0: expected 1 to 1000"),
        ("multilevel", ["GoToObj"], None, "study 'multilevel' has no GoToObj: expected GoToLocal, PickupLoc, PutNextLocal"),
        ("stages", ["BossLevel"], None, "no entry GuideGrid-BossLevel-v0"),
        ("stages", ["GoToMars"], None, "GoToMars"),
    ],
)
def test_wrong_questions(study: str, levels: list[str], seeds: int | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        load_catalogue().runs(study, levels, seeds)


@pytest.mark.parametrize(("file", "study"), [("mine.yml", "mine"), ("forms.yml", "forms")])
def test_the_examples_of_the_docs(file: str, study: str, tmp_path: Path) -> None:
    (example,) = re.findall(rf"```yaml\n# {file}\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    (tmp_path / file).write_text(example)
    assert load_catalogue(tmp_path / file).runs(study)


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"train_episodes": 1001}, "condition 'x' is to train on 1001 episodes of GoToObj, of which 1000 are recorded"),
        ({"recorded_episodes": 20}, "recorded_episodes are unknown: expected NAME:VALUE of train_episodes"),
        ({"learning_rate": -1}, "learning_rate=-1: expected a number from 0"),
    ],
)
def test_hyper_parameters_that_are_not_possible(params: dict[str, object], message: str, tmp_path: Path) -> None:
    study = {"grids": [{"levels": ["GoToObj"], "conditions": ["x"], "seeds": 1}]}
    conditions = {"x": {"agent": "learner", "params": params}}
    catalogue = load_catalogue(write(tmp_path / "mine.yml", conditions=conditions, studies={"mine": study}))
    with pytest.raises(ValueError, match=message):
        catalogue.runs("mine")


def test_a_level_without_a_shipped_expert(tmp_path: Path) -> None:
    study = {"grids": [{"levels": ["PutNextLocal", "Open"], "conditions": ["learner"], "seeds": 1}]}
    catalogue = load_catalogue(write(tmp_path / "mine.yml", studies={"mine": study}))
    with pytest.raises(ValueError, match="Open"):
        catalogue.runs("mine")
