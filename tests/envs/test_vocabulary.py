"""Missions become tokens and come back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sb3_guide.envs import LEVELS, MISSION_LENGTH, VOCABULARY_SIZE, WORDS, GuideGridVecEnv, decode, encode

CLAUSE = "put a red ball in front of you next to a blue box in front of you"
LONGEST = f"{CLAUSE} and {CLAUSE}, then {CLAUSE} and {CLAUSE}"


def test_tokens_worked_out_by_hand() -> None:
    """The vocabulary is fixed: models depend on it."""
    assert encode("go to the red ball")[:7].tolist() == [1, 2, 7, 9, 15, 0, 0]
    assert encode("open the door, then go to a key")[:5].tolist() == [28, 7, 27, 32, 30]
    assert VOCABULARY_SIZE == len(WORDS) == len(set(WORDS)) == 33


def test_the_longest_mission_fits() -> None:
    """Four clauses of two objects with colours and locations."""
    assert np.count_nonzero(encode(LONGEST)) == MISSION_LENGTH == 72
    assert decode(encode(LONGEST)) == LONGEST


@pytest.mark.parametrize("level", LEVELS)
def test_missions_of_all_levels_come_back(level: str) -> None:
    """What the engine writes is what `encode` would."""
    env = GuideGridVecEnv(level, 50, seed=0, history=0)
    tokens = env.reset()["mission"]
    np.testing.assert_array_equal(tokens, [encode(mission) for mission in env.missions])


@given(st.lists(st.sampled_from(WORDS[1:-1]), max_size=MISSION_LENGTH))
def test_any_words_come_back(words: list[str]) -> None:
    """Without commas, text and words are the same."""
    assert decode(encode(" ".join(words))) == " ".join(words)


def test_wrong_missions_are_refused() -> None:
    """The error names the words."""
    with pytest.raises(ValueError, match=r"\['dragon'\]"):
        encode("go to the dragon")
    with pytest.raises(ValueError, match="73 words"):
        encode("go " * 73)


@pytest.mark.parametrize("tokens", [np.array([33]), np.array([-1]), np.zeros((2, 2))])
def test_wrong_tokens_are_refused(tokens: np.ndarray) -> None:
    """The error names the range."""
    with pytest.raises(ValueError, match="0 to 32"):
        decode(tokens)
