"""One fixed vocabulary for the missions of all levels."""

from __future__ import annotations

import numpy as np

#: the word of each token; that of 0 is padding
WORDS = (
    "",  # padding
    *("go", "to", "pick", "up", "put", "next", "the", "a"),
    *("red", "green", "blue", "purple", "yellow", "grey", "ball", "box", "key"),
    *("on", "your", "left", "right", "in", "front", "of", "you", "behind"),
    *("door", "open", "and", "then", "after", ","),
)
VOCABULARY_SIZE = len(WORDS)  #: different tokens, padding included
MISSION_LENGTH = 72  #: words of the longest mission of all levels

_TOKENS = {word: token for token, word in enumerate(WORDS) if word}


def encode(mission: str) -> np.ndarray:
    """
    Turn a mission into tokens; the comma is a word of its own.

    :param mission: text as Minigrid writes it, such as "go to the red ball"
    :return: (72,) uint8, padded with 0
    :raises ValueError: if a word is unknown or the mission is too long
    """
    words = mission.replace(",", " ,").split()
    unknown = sorted(set(words) - set(_TOKENS))
    if unknown:
        raise ValueError(f"unknown words {unknown} in the mission {mission!r}: expected words of {sorted(_TOKENS)}")
    if len(words) > MISSION_LENGTH:
        raise ValueError(f"the mission has {len(words)} words, expected at most {MISSION_LENGTH}: {mission!r}")
    tokens = np.zeros(MISSION_LENGTH, dtype=np.uint8)
    tokens[: len(words)] = [_TOKENS[word] for word in words]
    return tokens


def decode(tokens: np.ndarray) -> str:
    """
    Turn tokens back into the mission's text.

    :param tokens: (length,) integers below VOCABULARY_SIZE; 0 is skipped
    :return: text as Minigrid writes it
    :raises ValueError: if a token is not of the vocabulary
    """
    values = np.asarray(tokens).astype(np.int64)
    if values.ndim != 1 or np.any((values < 0) | (values >= VOCABULARY_SIZE)):
        raise ValueError(f"expected a row of tokens from 0 to {VOCABULARY_SIZE - 1}, got {values.tolist()}")
    return " ".join(WORDS[token] for token in values if token).replace(" ,", ",")
