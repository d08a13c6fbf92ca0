"""Speaking to agents and taking their words away, as commands on the shipped agents."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file
from scipy.stats import binomtest

from sb3_guide.cloning import Demonstrations, mission_seeds, play, save_demonstrations
from sb3_guide.cloning.demonstrations import FORMAT
from sb3_guide.envs import ACTIONS
from sb3_guide.experiments import cli
from sb3_guide.experiments.stages import speak
from sb3_guide.experiments.stages.ablate import ablate_agent
from sb3_guide.experiments.stages.analyze import analyze
from sb3_guide.experiments.stages.levels import level_of_agent
from sb3_guide.experiments.stages.speak import speak_to, text_of
from sb3_guide.experiments.stages.statistics import paired_successes, wilson_interval
from sb3_guide.experts import expert_folder, load_expert
from sb3_guide.files import checksum
from sb3_guide.language import Dictionary
from sb3_guide.policies.channel import MessageShape
from sb3_guide.policies.folder import read_agent, write_agent
from sb3_guide.speakers import speaker_folder

GUIDED = {"agent": speaker_folder("GoToLocal", "guided"), "level": None, "seed": 0, "threads": 1}


@pytest.mark.parametrize("guidance", ["waltz", "file", "say"])
def test_a_choreography_is_danced(guidance, tmp_path):
    file = tmp_path / "mine.txt"
    file.write_text("forward\nforward, left  # round the corner\n" * 4)
    script = {"waltz": ([], "waltz"), "file": ([], str(file)), "say": (["forward", "left"], None)}[guidance]
    speak_to(say=script[0], choreography=script[1], measure=False, out=tmp_path / "out", **{**GUIDED, **mirrored(guidance)})
    walk = json.loads((tmp_path / "out" / "speech.json").read_text())["walk"]
    assert walk["meant"] == walk["taken"]
    assert (tmp_path / "out" / "walk.png").read_bytes().startswith(b"\x89PNG")


def mirrored(guidance: str) -> dict[str, object]:
    """The agent that has the words: one for left on GoToLocal, one for right on PutNextLocal's Guide."""
    return {"agent": speaker_folder("PutNextLocal", "guide")} if guidance == "waltz" else {}


def test_an_agent_that_only_knows_left_turns_left():
    counts = np.zeros((9, len(ACTIONS)), dtype=np.int64)
    counts[0, ACTIONS.index("left")] = counts[4, ACTIONS.index("forward")] = 100
    one_sided = Dictionary(MessageShape(), counts)
    assert text_of("pirouette", one_sided) == "left, left, left, left"
    counts[8, ACTIONS.index("right")] = 100
    assert text_of("pirouette", one_sided) == "right, right, right, right"


def test_obedience_is_the_same_each_time(tmp_path):
    for out in ("a", "b"):
        speak_to(say=[], choreography=None, measure=True, out=tmp_path / out, **GUIDED)
    found = [json.loads((tmp_path / out / "speech.json").read_text())["obedience"] for out in ("a", "b")]
    assert found[0] == found[1]
    assert found[0]["messages"] == 500
    assert found[0]["raw"] > 0.9


def test_an_agent_that_takes_one_action_only_is_not_corrected_for_chance(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(speak, "obey", lambda *_: (np.array([2, 2, 2]), np.array([2, 2, 2])))
    speak_to(say=[], choreography=None, measure=True, out=tmp_path, **GUIDED)
    found = json.loads((tmp_path / "speech.json").read_text())["obedience"]
    assert (found["raw"], found["corrected"]) == (1, None)
    assert "obeyed 100.0% of 3 messages; as it only ever took one action" in capsys.readouterr().out


def test_an_agent_whose_messages_mean_nothing_is_not_asked_to_obey(tmp_path, monkeypatch, capsys):
    silent = Dictionary(MessageShape(), np.zeros((9, len(ACTIONS)), dtype=np.int64))
    monkeypatch.setattr(speak, "overhear", lambda *_: silent)
    speak_to(say=[], choreography=None, measure=True, out=tmp_path, **GUIDED)
    found = json.loads((tmp_path / "speech.json").read_text())
    assert found["obedience"] == {"messages": 0, "raw": None, "corrected": None, "by_action": {}}
    assert "there is nothing to obey" in capsys.readouterr().out


def test_unknown_choreographies_and_words(tmp_path):
    arguments = {"measure": False, "out": tmp_path / "out", **GUIDED}
    with pytest.raises(FileNotFoundError, match="there is no choreography 'polka': expected pirouette, waltz"):
        speak_to(say=[], choreography="polka", **arguments)
    with pytest.raises(ValueError, match="no word for 'toggle'"):
        speak_to(say=["toggle"], choreography=None, **arguments)


def test_what_each_intervention_costs(tmp_path):
    ablate_agent(GUIDED["agent"], "GoToLocal", 40, tmp_path / "ablation.json", threads=1)
    found = json.loads((tmp_path / "ablation.json").read_text())["interventions"]
    assert list(found) == ["spoken", "silent", "uniform", "marginal", "shuffled", "delayed", "swapped 0", "swapped 1"]
    assert found["spoken"]["success_rate"] > 0.9 > found["silent"]["success_rate"]
    assert found["silent"]["p_value"] < 0.001


@pytest.mark.parametrize("trials", [1, 7, 500])
def test_wilson_intervals_are_those_of_scipy(trials):
    for successes in {0, 1, trials // 3, trials - 1, trials}:
        expected = binomtest(successes, trials).proportion_ci(method="wilson")
        assert wilson_interval(successes, trials) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_paired_successes_by_hand():
    a, b = np.array([1, 1, 0, 0, 0, 0], dtype=bool), np.array([1, 0, 1, 1, 1, 1], dtype=bool)
    found = paired_successes(a, b)
    assert found["difference"] == pytest.approx(-0.5)
    assert found["p_value"] == pytest.approx(2 * (1 + 5) / 2**5)  # one against four of five that differ
    assert paired_successes(a, a)["p_value"] == 1
    few = paired_successes(np.array([1, 1, 0], dtype=bool), np.zeros(3, dtype=bool))
    assert (few["difference_low"], few["difference_high"]) == (pytest.approx(-0.768, abs=0.001), 1)
    with pytest.raises(ValueError, match="expected the same missions, at least 2"):
        paired_successes(a, b[:5])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Folder with demonstrations of GoToObj, with ones of nothing, and with a choreography that has a typo."""
    folder = tmp_path_factory.mktemp("files")
    episodes = play(load_expert("GoToObj").policy, "GoToObj", mission_seeds("analysis", 4))
    save_demonstrations(Demonstrations(episodes, "GoToObj", {}), folder / "other.safetensors")
    nothing = {name: array[:0] for name, array in episodes.arrays().items()} | {"offsets": episodes.offsets[:1]}
    header = {"format": FORMAT, "level": "GoToLocal", "provenance": "{}"}
    save_file(nothing, folder / "empty.safetensors", {**header, "sha256": checksum(nothing, header)})
    (folder / "dance.txt").write_text("forward\nrigth")
    return folder


LOCAL = str(speaker_folder("GoToLocal", "guided"))
MUTE = str(expert_folder("GoToLocal"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["speak", LOCAL, "--say", "w0"], "step 'w0' is unknown: expected one of left"),
        (["speak", LOCAL, "--say", "w0 w3"], "or a message of 2 words from w0 to w2, such as 'w0 w1'"),
        (["speak", LOCAL, "--choreography", "dance.txt"], "step 'rigth' is unknown"),
        (["speak", LOCAL, "--level", "PickupLoc"], "was not trained on PickupLoc: expected --level GoToLocal"),
        (["analyze", LOCAL, "--level", "PickupLoc"], "was not trained on PickupLoc: expected --level GoToLocal"),
        (["ablate", LOCAL, "--level", "PickupLoc"], "was not trained on PickupLoc: expected --level GoToLocal"),
        (["speak", MUTE], "sends no messages: expected a GuidePolicy or a GuidedLearnerPolicy"),
        (["analyze", MUTE], "sends no messages: expected a GuidePolicy or a GuidedLearnerPolicy"),
        (["ablate", MUTE], "sends no messages: expected a GuidePolicy or a GuidedLearnerPolicy"),
        (["analyze", LOCAL, "--guide", MUTE], "sends no messages: expected a GuidePolicy or a GuidedLearnerPolicy"),
        (["analyze", LOCAL, "--demos", "none"], "none does not exist: expected demonstrations"),
        (["analyze", LOCAL, "--demos", "other.safetensors"], "holds demonstrations of GoToObj: expected GoToLocal"),
        (["analyze", LOCAL, "--demos", "empty.safetensors"], "0 episodes, 0 of them failed: expected at least one"),
        (["speak", LOCAL, "--choreography", "other.safetensors"], "other.safetensors is no text in UTF-8"),
        (["speak", LOCAL, "--choreography", "waltz", "--say", "left"], "leave out --say or --choreography"),
        (["ablate", LOCAL, "--episodes", "1"], "episodes=1: expected at least 2"),
    ],
)
def test_bad_input_ends_with_one_line(arguments, message, files, tmp_path, monkeypatch):
    monkeypatch.chdir(files)
    out = tmp_path / ("out.json" if arguments[0] == "ablate" else "out")
    monkeypatch.setattr(sys, "argv", ["sb3-guide", *arguments, "--out", str(out)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert message in str(ended.value)
    assert "\n" not in str(ended.value)


def test_an_agent_plays_a_level_that_it_was_trained_on(tmp_path):
    description, weights = read_agent(speaker_folder("GoToObj", "guide"))
    trained = {"one": "GoToObj", "id": "GuideGrid-GoToObj-v0", "several": "GoToLocal+PickupLoc", "unknown": None}
    for name, level in trained.items():
        write_agent(tmp_path / name, replace(description, level=level), weights)
    assert level_of_agent(tmp_path / "one", None) == "GoToObj"
    assert level_of_agent(tmp_path / "id", None) == level_of_agent(tmp_path / "id", "GoToObj") == "GoToObj"
    assert level_of_agent(tmp_path / "several", "GuideGrid-PickupLoc-v0") == "PickupLoc"
    assert level_of_agent(tmp_path / "unknown", "GoTo") == "GoTo"
    with pytest.raises(ValueError, match="expected --level GoToLocal or --level PickupLoc"):
        level_of_agent(tmp_path / "several", None)
    with pytest.raises(ValueError, match="not trained on GoToObj: expected --level GoToLocal or --level PickupLoc"):
        level_of_agent(tmp_path / "several", "GoToObj")
    with pytest.raises(ValueError, match="expected --level NAME"):
        level_of_agent(tmp_path / "unknown", None)


@pytest.mark.parametrize(
    "arguments",
    [
        ["evaluate", MUTE, "--level", "GoToLocal", "--out", "agent.json"],
        ["evaluate", MUTE, "--level", "GoToLocal", "--out", "network.safetensors"],
        ["evaluate", MUTE, "--level", "GoToLocal", "--out", "."],
        ["ablate", LOCAL, "--out", "agent.json"],
        ["analyze", LOCAL, "--out", "."],
        ["analyze", LOCAL, "--out", "agent.json"],
        ["evaluate", MUTE, "--level", "GoToLocal", "--out", "agent.json/found.json"],
        ["speak", LOCAL, "--out", "."],
        ["record", "--level", "GoToLocal", "--expert", MUTE, "--episodes", "3", "--out", "network.safetensors"],
        ["record", "--level", "GoToLocal", "--expert", MUTE, "--episodes", "3", "--out", "agent.safetensors"],
    ],
)
def test_what_another_has_made_is_not_written_over(arguments, tmp_path, monkeypatch):
    for path in Path(LOCAL).iterdir():
        shutil.copy(path, tmp_path)
    for name in ("analysis.json", "speech.json"):
        shutil.copy(Path(LOCAL) / "agent.json", tmp_path / name)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["sb3-guide", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    expected = (
        "holds something else",
        "expected the name of a file that ends in .json",
        "agent.json is a file: choose another",
    )
    assert any(reason in str(ended.value) for reason in expected)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_figures_of_an_earlier_call_do_not_stay(tmp_path):
    out, guide = tmp_path / "analysis", speaker_folder("GoToLocal", "guide")
    analyze(Path(LOCAL), None, None, guide, out, threads=1, n_episodes=10)
    assert (out / "change.png").is_file()
    analyze(Path(LOCAL), None, None, None, out, threads=1, n_episodes=10)
    assert not (out / "change.png").exists()
    assert (out / "situations.png").is_file()
