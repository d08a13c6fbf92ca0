"""The agents with a channel that are shipped."""

import numpy as np
import pytest

from sb3_guide import load_dictionary, load_guide, load_guided_learner, speakers
from sb3_guide.cloning import mission_seeds, play
from sb3_guide.envs import ACTIONS
from sb3_guide.files import read_json

SHIPPED = sorted((path.parent.parent.name, path.parent.name) for path in speakers.FOLDER.glob("*/*/agent.json"))


@pytest.mark.parametrize(("level", "agent"), SHIPPED)
def test_a_speaker_plays_as_its_card_says(level, agent):
    policy = (load_guide if agent == "guide" else load_guided_learner)(level)
    rate = read_json(speakers.speaker_folder(level, agent) / "evaluation.json")["success_rate"]
    successes = play(policy, level, mission_seeds("validation", 200)).successes.mean()
    assert successes == pytest.approx(rate, abs=4 * np.sqrt(rate * (1 - rate) / 200) + 0.01)
    assert f"{rate:.1%}" in (speakers.FOLDER / level / agent / "README.md").read_text()


@pytest.mark.parametrize(("level", "agent"), SHIPPED)
def test_a_speakers_dictionary_is_that_of_its_card(level, agent):
    dictionary = load_dictionary(level, agent)
    card = (speakers.FOLDER / level / agent / "README.md").read_text()
    for message in np.flatnonzero(dictionary.counts.sum(axis=1)):
        counts, name = dictionary.counts[message], dictionary.shape.names()[message]
        assert f"| {name} | {ACTIONS[counts.argmax()]} | {counts.max() / counts.sum():.0%} | {counts.sum():,} |" in card


def test_both_agents_of_four_levels_are_shipped():
    assert len(SHIPPED) == 8


def test_a_level_without_speakers():
    with pytest.raises(ValueError, match=r"no trained guide for BossLevel: expected one of .*GoToObj/guide"):
        load_guide("BossLevel")
