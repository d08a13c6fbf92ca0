"""Frames of several episodes (or windows of them) without padding."""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import torch as th
from gymnasium import spaces

from sb3_guide.policies.rows import distinct_rows, is_plain

Observations = dict[str, th.Tensor]
MISSION_CHANGED = (
    "a mission changed within an episode: agents that carry their memory, and demonstrations, expect the same one from "
    "beginning to end; PPO and A2C, whose agents read a window, do not"
)
LONGS_AT_ONCE = 2**24  # numbers that are hashed at once, which bounds the memory that large pictures take


class Sequences(NamedTuple):
    """
    B sequences of K frames in all, one sequence after the other. Padding is never part of it, so no network computes on it.

    :param images: (K, height, width, channels), or (K, channels, height, width) as SB3 turns pictures
    :param missions: (B, words) one row a sequence
    :param lengths: (B,) int64, every one at least 1; they add up to K
    """

    images: th.Tensor
    missions: th.Tensor
    lengths: th.Tensor

    def to(self, device: th.device) -> "Sequences":
        """:return: the same on a device"""
        return Sequences(*(part.to(device) for part in self))


def frames(observations: Observations) -> Sequences:
    """
    The present image of each world, as a sequence of its own.

    :param observations: "image" (B, ...) and, where there are missions, "mission" (B, words)
    """
    images = observations["image"]
    return Sequences(images, missions_of(observations), th.ones(len(images), dtype=th.long, device=images.device))


@dataclass(frozen=True)
class Windows:
    """
    What a window policy remembers of B worlds: the last T images of each, the present one last.

    :param images: (B, T, ...)
    :param missions: (B, words)
    """

    images: th.Tensor
    missions: th.Tensor

    @cached_property
    def began(self) -> th.Tensor:
        """(B, T) bool, which images belong to the episode: the first that is not blank, those after it and the present one."""
        began = self.images.flatten(2).any(dim=-1).cumsum(dim=1) > 0
        began[:, -1] = True
        return began

    def sequences(self) -> Sequences:
        """:return: the same without what was before the episodes began"""
        return Sequences(self.images[self.began], self.missions, self.began.sum(dim=1))


def windows(observations: Observations) -> Windows:
    """
    The history of an episode that has just begun starts with zeros; blank images that an environment shows before anything
    else are left out with them.

    :param observations: "image" (B, ...), "mission" (B, words) and, where the environment keeps one, "history" (B, n, ...)
    """
    images = observations["image"].unsqueeze(1)
    if "history" in observations:
        history = observations["history"]
        if history.shape[2:] != images.shape[2:]:
            history = history.movedim(-1, 2)  # SB3 turns a picture to have its channels first, but not the pictures before it
        images = th.cat([history, images], dim=1)
    return Windows(images, missions_of(observations))


def unpadded(observations: Observations, n_seq: int) -> tuple[Sequences, th.Tensor]:
    """
    Sequences as RecurrentPPO pads them, with zeros at their ends. Padding has no mission, by which it is told from frames.
    Where there are no missions, or an empty one, it is not: then it counts as frames, which costs time and changes nothing,
    as nothing follows it and RecurrentPPO ignores what becomes of it.

    :param observations: of n_seq sequences of T steps each, flattened
    :param n_seq: how many sequences
    :return: the sequences, and (n_seq, T) bool, which steps are theirs
    :raises ValueError: if a mission changes within a sequence
    """
    images, missions = (part.unflatten(0, (n_seq, -1)) for part in (observations["image"], missions_of(observations)))
    speaks = missions.ne(0).any(dim=-1)  # (n_seq, T)
    valid = speaks | ~speaks[:, :1]
    if (missions.ne(missions[:, :1]).any(dim=-1) & valid).any():
        raise ValueError(MISSION_CHANGED)
    return Sequences(images[valid], missions[:, 0], valid.sum(dim=1)), valid


def padded(of_frames: th.Tensor, valid: th.Tensor) -> th.Tensor:
    """
    :param of_frames: (K, ...)
    :param valid: bool, which steps the K frames are
    :return: of the shape of valid and of what a frame has, zeros at all other steps
    """
    found = of_frames.new_zeros(*valid.shape, *of_frames.shape[1:])
    found[valid] = of_frames
    return found


def missions_of(observations: Observations) -> th.Tensor:
    """:return: (B, words), a single word of padding where there are no missions"""
    images = observations["image"]
    return observations.get("mission", images.new_zeros(len(images), 1))


def distinct(rows: th.Tensor, more: th.Tensor | None = None) -> tuple[th.Tensor, th.Tensor]:
    """
    Rows that occur, each once. Of large pictures, and on other devices than the CPU, 64-bit hashes are compared, as sorting
    whole rows costs more than the encoding it would save; two rows among a million share a hash with probability 3e-8.

    :param rows: (N, D) of any integral values
    :param more: (N, E), what stands beside each
    :return: index of one representative a distinct row (U,), and for every row the position of its representative (N,)
    """
    more = rows[:, :0] if more is None else more
    if is_plain(rows, more) and len(rows) == len(more) and rows.numel() <= LONGS_AT_ONCE:
        first, position = distinct_rows(rows.long().numpy(), more.long().numpy())
        return th.from_numpy(first), th.from_numpy(position)
    weights = hash_weights(rows.shape[1] + more.shape[1], rows.device)
    hashes = hashed(rows, weights[: rows.shape[1]]) + hashed(more, weights[rows.shape[1] :])
    _, inverse = th.unique(hashes, return_inverse=True)
    first = th.empty(int(inverse.max()) + 1, dtype=th.long, device=hashes.device)
    first[inverse] = th.arange(len(hashes), device=hashes.device)
    return first, inverse


def hashed(rows: th.Tensor, weights: th.Tensor) -> th.Tensor:
    """:return: (N,) int64, sums of a row's values times the weights (D,)"""
    at_once = max(1, LONGS_AT_ONCE // max(1, len(weights)))
    return th.cat([(part.long() * weights).sum(dim=1) for part in rows.split(at_once)])


@cache
def hash_weights(width: int, device: th.device) -> th.Tensor:
    """:return: (width,) int64 random numbers, always the same"""
    return th.randint(-(2**63), 2**63 - 1, (width,), generator=th.Generator().manual_seed(0)).to(device)


def history_of(observation_space: spaces.Space) -> int:
    """:return: images before the present one that an observation space holds"""
    history = observation_space.spaces.get("history") if isinstance(observation_space, spaces.Dict) else None
    return 0 if history is None or history.shape is None else history.shape[0]
