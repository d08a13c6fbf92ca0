"""Missions as tokens: the fixed vocabulary of our levels, and those that are built for other environments."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium import spaces

from sb3_guide.files import read_json, write_json

_PUNCTUATION = r",.;:!?"  # each of them is a word of its own


@dataclass(frozen=True)
class Vocabulary:
    """
    The words that missions are made of.

    :param words: by token; the first is "", which pads
    :param length: words of the longest mission
    :raises ValueError: if a word is there twice, the first is none of padding, or missions have no words
    """

    words: tuple[str, ...]
    length: int

    def __post_init__(self) -> None:
        if self.words[:1] != ("",) or len(set(self.words)) != len(self.words) or self.length < 1:
            raise ValueError(
                f"{len(self.words)} words from {self.words[:1]} on, missions of {self.length}: expected '' for padding first, "
                "no word twice, and missions of at least 1 word"
            )

    @classmethod
    def of(cls, missions: Iterable[str]) -> Vocabulary:
        """
        :param missions: all that there are, or as many as it takes to meet every word and the longest of them
        :return: their words in alphabetical order
        """
        parts = [_split(mission) for mission in missions]
        return cls(("", *sorted({word for part in parts for word in part})), max([1, *map(len, parts)]))

    @classmethod
    def sampled(cls, env: gymnasium.Env, resets: int = 1000) -> Vocabulary:
        """
        Read the missions of an environment that says them as text.

        :param env: whose observations have a "mission"
        :param resets: how often to begin an episode, with the seeds 0, 1, 2 ...; a word that never occurs stays unknown
        """
        return cls.of(env.reset(seed=seed)[0]["mission"] for seed in range(resets))

    @classmethod
    def load(cls, path: str | Path) -> Vocabulary:
        """
        :param path: of a file that :meth:`save` wrote
        :raises FileNotFoundError: if there is none
        :raises ValueError: if it holds no vocabulary
        """
        if not Path(path).is_file():
            raise FileNotFoundError(f"{path} does not exist: expected a vocabulary as Vocabulary.save writes it")
        content = read_json(Path(path))
        try:
            return cls(tuple(map(str, content["words"])), int(content["length"]))
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path} holds no vocabulary ({error}): expected JSON as Vocabulary.save writes it") from error

    def save(self, path: str | Path) -> None:
        """
        Write the vocabulary as JSON. An agent means its tokens by this vocabulary: keep it with the agent.

        :param path: of the file; its folder is made if need be
        """
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        write_json(Path(path), {"words": self.words, "length": self.length})

    @cached_property
    def space(self) -> spaces.Box:
        """Where missions are as tokens, (length,)."""
        return spaces.Box(0, len(self.words) - 1, (self.length,), np.uint8 if len(self.words) <= 256 else np.int32)

    @cached_property
    def _tokens(self) -> dict[str, int]:
        return {word: token for token, word in enumerate(self.words) if word}

    def encode(self, mission: str) -> np.ndarray:
        """
        Turn a mission into tokens; a comma or another mark is a word of its own.

        :param mission: text such as "go to the red ball"
        :return: (length,) of the dtype of :attr:`space`, padded with 0
        :raises ValueError: if a word is unknown or the mission is too long
        """
        words = _split(mission)
        unknown = sorted(set(words) - set(self._tokens))
        if unknown:
            raise ValueError(f"unknown words {unknown} in the mission {mission!r}: expected words of {sorted(self._tokens)}")
        if len(words) > self.length:
            raise ValueError(f"the mission has {len(words)} words, expected at most {self.length}: {mission!r}")
        encoded = np.zeros(self.length, dtype=self.space.dtype)
        encoded[: len(words)] = [self._tokens[word] for word in words]
        return encoded

    def decode(self, tokens: np.ndarray) -> str:
        """
        Turn tokens back into the mission's text.

        :param tokens: (length,) integers, each a word's; 0 is skipped
        :return: text as it was encoded, with single spaces
        :raises ValueError: if a token is not of the vocabulary
        """
        values = np.asarray(tokens).astype(np.int64)
        if values.ndim != 1 or np.any((values < 0) | (values >= len(self.words))):
            raise ValueError(f"expected a row of tokens from 0 to {len(self.words) - 1}, got {values.tolist()}")
        return re.sub(rf" ([{_PUNCTUATION}])", r"\1", " ".join(self.words[token] for token in values if token))


def _split(mission: str) -> list[str]:
    return re.sub(rf"([{_PUNCTUATION}])", r" \1 ", mission).split()


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

LEVELS_VOCABULARY = Vocabulary(WORDS, MISSION_LENGTH)


def encode(mission: str) -> np.ndarray:
    """
    Turn a mission of our levels into tokens.

    :param mission: text as Minigrid writes it, such as "go to the red ball"
    :return: (72,) uint8, padded with 0
    :raises ValueError: if a word is unknown or the mission is too long
    """
    return LEVELS_VOCABULARY.encode(mission)


def decode(tokens: np.ndarray) -> str:
    """
    Turn tokens back into the text of a mission of our levels.

    :param tokens: (length,) integers below VOCABULARY_SIZE; 0 is skipped
    :return: text as Minigrid writes it
    :raises ValueError: if a token is not of the vocabulary
    """
    return LEVELS_VOCABULARY.decode(tokens)
