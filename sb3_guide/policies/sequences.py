"""Frames of several episodes (or windows of them) without padding."""

from functools import cache
from typing import NamedTuple

import torch as th
from gymnasium import spaces

Observations = dict[str, th.Tensor]


class Sequences(NamedTuple):
    """
    B sequences of K frames in all, one sequence after the other. Padding is never part of it, so no network computes on it.

    :param images: (K, 7, 7, 3)
    :param missions: (B, 72) one row a sequence
    :param lengths: (B,) int64, every one at least 1; they add up to K
    """

    images: th.Tensor
    missions: th.Tensor
    lengths: th.Tensor


def frames(observations: Observations) -> Sequences:
    """
    The present image of each world, as a sequence of its own.

    :param observations: "image" (B, 7, 7, 3) and "mission" (B, 72)
    """
    images = observations["image"]
    return Sequences(images, observations["mission"], th.ones(len(images), dtype=th.long, device=images.device))


def windows(observations: Observations) -> Sequences:
    """
    The frames that a window policy remembers: history, then the present image. Frames before the episode began are all
    zeros, which no real image is.

    :param observations: "image" (B, 7, 7, 3), "mission" (B, 72) and, where the level keeps one, "history" (B, n, 7, 7, 3)
    """
    images = observations["image"].unsqueeze(1)
    if "history" in observations:
        images = th.cat([observations["history"], images], dim=1)
    began = images.flatten(2).ne(0).any(dim=-1)  # (B, n + 1)
    began[:, -1] = True
    return Sequences(images[began], observations["mission"], began.sum(dim=1))


def distinct(rows: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
    """
    Rows that occur, each once. Compares 64-bit hashes, as sorting whole rows costs more than the encoding it would save;
    two different rows among a million share a hash with probability 3e-8.

    :param rows: (N, D) of any integral values
    :return: index of one representative a distinct row (U,), and for every row the position of its representative (N,)
    """
    _, inverse = th.unique((rows.long() * hash_weights(rows.shape[1], rows.device)).sum(dim=1), return_inverse=True)
    first = th.empty(int(inverse.max()) + 1, dtype=th.long, device=rows.device)
    first[inverse] = th.arange(len(rows), device=rows.device)
    return first, inverse


@cache
def hash_weights(width: int, device: th.device) -> th.Tensor:
    """:return: (width,) int64 random numbers, always the same"""
    return th.randint(-(2**63), 2**63 - 1, (width,), generator=th.Generator().manual_seed(0)).to(device)


def history_of(observation_space: spaces.Space) -> int:
    """:return: images before the present one that an observation space holds"""
    history = observation_space.spaces.get("history") if isinstance(observation_space, spaces.Dict) else None
    return 0 if history is None or history.shape is None else history.shape[0]
