"""Words and their meanings."""

import numpy as np
import pytest

from sb3_guide.envs import ACTIONS
from sb3_guide.language import Dictionary, read_dictionary, save_dictionary
from sb3_guide.policies.channel import MessageShape

LEFT, RIGHT, FORWARD = (ACTIONS.index(name) for name in ("left", "right", "forward"))


def dictionary(**counts: dict[int, int]) -> Dictionary:
    """Of messages of two symbols of two words; what each message was followed by."""
    table = np.zeros((4, len(ACTIONS)), dtype=np.int64)
    for message, followed in counts.items():
        for action, frames in followed.items():
            table[int(message[1:]), action] = frames
    return Dictionary(MessageShape(2, 2), table)


def test_a_message_means_what_strongly_and_often_follows_it():
    words = dictionary(m0={LEFT: 90, RIGHT: 10}, m1={LEFT: 70, RIGHT: 30}, m2={FORWARD: 19})
    assert words.meanings.tolist() == [LEFT, -1, -1, -1]
    assert words.probabilities[1, LEFT] == pytest.approx(0.7)
    assert np.isnan(words.probabilities[3]).all()


def test_of_two_words_for_the_same_the_commoner_is_spoken():
    words = dictionary(m0={LEFT: 50}, m3={LEFT: 60}, m1={RIGHT: 90})
    assert words.message_for(LEFT) == 3


def test_what_cannot_be_said_is_named():
    with pytest.raises(ValueError, match="no word for 'right': its messages mean left, forward"):
        dictionary(m0={LEFT: 50}, m1={FORWARD: 50}).message_for(RIGHT)
    with pytest.raises(ValueError, match="its messages mean none"):
        dictionary().message_for(RIGHT)


def test_an_action_is_said_in_a_word():
    words = dictionary(m0={LEFT: 50}, m3={FORWARD: 60})
    assert words.word("forward") == "w1 w1"
    with pytest.raises(ValueError, match="'jump' is no action: expected one of left, right"):
        words.word("jump")


def test_a_dictionary_is_kept(tmp_path):
    words = dictionary(m0={LEFT: 50, RIGHT: 2}, m3={FORWARD: 60})
    save_dictionary(words, tmp_path / "dictionary.json")
    again = read_dictionary(tmp_path / "dictionary.json")
    assert (again.shape, again.actions) == (words.shape, words.actions)
    assert np.array_equal(again.counts, words.counts)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{", "is no"),
        ("[]", "holds a list: expected a dict"),
        ('{"shape": {"length": 2}}', "is no"),
        ('{"shape": {"length": 1, "vocabulary_size": 2}, "actions": ["left"], "followed": {"w0": {"jump": 1}}}', "is no"),
        ('{"shape": {"length": 1, "vocabulary_size": 2}, "actions": ["left"], "followed": {"w2": {"left": 1}}}', "is no"),
    ],
)
def test_a_damaged_dictionary_is_refused(text, problem, tmp_path):
    (tmp_path / "dictionary.json").write_text(text)
    with pytest.raises(ValueError, match=rf"dictionary\.json {problem}"):
        read_dictionary(tmp_path / "dictionary.json")
