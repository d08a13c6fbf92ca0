"""Demonstrations on disk: one safetensors file, without pickle, with checksum and provenance."""

import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from sb3_guide.cloning.episodes import Episodes, concatenate
from sb3_guide.files import checksum, read_arrays, write_arrays

FORMAT = "sb3-guide demonstrations 2"
ARRAYS_CHECKED = "sb3-guide demonstrations 1"  # the format before: its checksum is of the arrays alone


@dataclass(frozen=True)
class Demonstrations:
    """
    Successful episodes of an expert and where they come from.

    :param episodes: all of them successful
    :param level: name of the level
    :param provenance: JSON that tells how they were made
    :raises ValueError: if there are none, or one has failed
    """

    episodes: Episodes
    level: str
    provenance: dict[str, Any]

    def __post_init__(self) -> None:
        failed = len(self.episodes) - int(self.episodes.successes.sum())
        if not len(self.episodes) or failed:
            raise ValueError(
                f"{len(self.episodes)} episodes, {failed} of them failed: expected at least one, and successful ones only"
            )

    def first(self, n_episodes: int) -> "Demonstrations":
        """
        :param n_episodes: how many to keep
        :raises ValueError: if there are not so many
        """
        if not 1 <= n_episodes <= len(self.episodes):
            raise ValueError(f"train_episodes={n_episodes}: expected 1 to {len(self.episodes)}, the number of demonstrations")
        return Demonstrations(self.episodes.select(np.arange(n_episodes)), self.level, self.provenance)


def pool(parts: Sequence[Demonstrations]) -> Demonstrations:
    """
    :param parts: of one or several levels
    :return: all of them together
    :raises ValueError: if their images or missions are of different forms
    """
    for name in ("image", "mission"):
        shapes = [(part.level, getattr(part.episodes, f"{name}s").shape[1:]) for part in parts]
        if len({shape for _, shape in shapes}) > 1:
            raise ValueError(f"demonstrations of different {name}s can't be pooled: their shapes are {dict(shapes)}")
    provenance = {part.level: part.provenance for part in parts}
    if len(provenance) < len(parts):
        raise ValueError(f"{len(parts)} demonstrations of {', '.join(provenance)}: expected each level once")
    return Demonstrations(concatenate([part.episodes for part in parts]), "+".join(provenance), provenance)


def check_place(path: Path) -> None:
    """
    To be called before demonstrations are made, which takes long.

    :param path: where they are to be saved
    :raises ValueError: if it is no name for demonstrations, or what they would take the place of are none
    """
    if path.suffix != ".safetensors":
        raise ValueError(f"{path} is to hold demonstrations: expected a name that ends in .safetensors")
    if path.exists() and read_arrays(path)[1].get("format") not in (FORMAT, ARRAYS_CHECKED):
        raise ValueError(f"{path} holds something else than demonstrations: choose another name or delete it")


def save_demonstrations(demonstrations: Demonstrations, path: str | Path) -> None:
    """
    Write a file atomically, with a checksum over all that is in it.

    :param demonstrations: what
    :param path: where; its folder is made if need be
    :raises ValueError: see :func:`check_place`
    """
    path, arrays = Path(path), demonstrations.episodes.arrays()
    check_place(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    header = {"format": FORMAT, "level": demonstrations.level, "provenance": json.dumps(demonstrations.provenance)}
    write_arrays(path, arrays, {**header, "sha256": checksum(arrays, header)})


def load_demonstrations(path: str | Path, level: str | None = None) -> Demonstrations:
    """
    A file of an earlier version, whose checksum leaves out level and provenance, is read with a warning.

    :param path: of a file written by :func:`save_demonstrations`
    :param level: name of the level that they are to be of; None takes those of any
    :raises FileNotFoundError: if there is no file
    :raises ValueError: if it is truncated, changed or no demonstrations, or of another level
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist: expected demonstrations made by sb3-guide record")
    try:
        arrays, header = read_arrays(path)
        expected, form = header.pop("sha256", None), header.get("format")
        if form not in (FORMAT, ARRAYS_CHECKED):
            raise ValueError(f"its format is {form!r}, expected {FORMAT!r}")
        if checksum(arrays, None if form == ARRAYS_CHECKED else header) != expected:
            raise ValueError("its contents don't match its checksum")
        demonstrations = Demonstrations(Episodes(**arrays), header["level"], json.loads(header["provenance"]))
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(f"{path} holds no usable demonstrations ({error}): record them anew") from error
    if form == ARRAYS_CHECKED:
        warnings.warn(
            f"{path} is of an earlier version, and its checksum leaves out level and provenance: make sure of where it is "
            "from, and save it anew with save_demonstrations(load_demonstrations(path), path)",
            stacklevel=2,
        )
    if level is not None and demonstrations.level != level:
        raise ValueError(f"{path} holds demonstrations of {demonstrations.level}: expected {level}")
    return demonstrations


def check_space(demonstrations: Demonstrations, observation_space: spaces.Dict) -> None:
    """
    :param demonstrations: to be cloned
    :param observation_space: of the agent
    :raises ValueError: if the agent could not have seen these observations
    """
    seen = {"image": demonstrations.episodes.images, "mission": demonstrations.episodes.missions}
    if not isinstance(observation_space, spaces.Dict) or not {"image"} <= observation_space.spaces.keys() <= seen.keys():
        raise ValueError(f"the agent observes {observation_space}: expected image and mission alone, as with history=0")
    for name, space in observation_space.spaces.items():
        values = seen[name]
        assert isinstance(space, spaces.Box)
        if values.shape[1:] != space.shape or values.dtype != space.dtype or values.max() > space.high.max():
            raise ValueError(
                f"{name} of the demonstrations is {values.dtype} {values.shape[1:]} up to {values.max()}: "
                f"expected {space} as the agent's level has it; record demonstrations of that level"
            )
