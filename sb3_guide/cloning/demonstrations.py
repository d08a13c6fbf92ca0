"""Demonstrations on disk: one safetensors file, without pickle, with checksum and provenance."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from sb3_guide.cloning.episodes import Episodes, concatenate
from sb3_guide.files import atomically

FORMAT = "sb3-guide demonstrations 1"


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
        shapes = {part.level: getattr(part.episodes, f"{name}s").shape[1:] for part in parts}
        if len(set(shapes.values())) > 1:
            raise ValueError(f"demonstrations of different {name}s can't be pooled: their shapes are {shapes}")
    provenance = {part.level: part.provenance for part in parts}
    return Demonstrations(concatenate([part.episodes for part in parts]), "+".join(provenance), provenance)


def checksum(episodes: Episodes) -> str:
    """:return: SHA-256 over names, types, shapes and contents of all arrays"""
    digest = hashlib.sha256()
    for name, array in sorted(episodes.arrays().items()):
        digest.update(f"{name} {array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def save_demonstrations(demonstrations: Demonstrations, path: str | Path) -> None:
    """
    Write a file atomically.

    :param demonstrations: what
    :param path: where; its folder is made if need be
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    metadata = {
        "format": FORMAT,
        "level": demonstrations.level,
        "provenance": json.dumps(demonstrations.provenance),
        "sha256": checksum(demonstrations.episodes),
    }
    arrays = {name: np.ascontiguousarray(array) for name, array in demonstrations.episodes.arrays().items()}
    with atomically(path) as partial:
        save_file(arrays, partial, metadata=metadata)


def load_demonstrations(path: str | Path) -> Demonstrations:
    """
    :param path: of a file written by :func:`save_demonstrations`
    :raises FileNotFoundError: if there is no file
    :raises ValueError: if it is truncated, changed or no demonstrations
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist: expected demonstrations made by sb3-guide record")
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  # it is no mapping
        if metadata.get("format") != FORMAT:
            raise ValueError(f"its format is {metadata.get('format')!r}, expected {FORMAT!r}")
        demonstrations = Demonstrations(Episodes(**arrays), metadata["level"], json.loads(metadata["provenance"]))
        if checksum(demonstrations.episodes) != metadata["sha256"]:
            raise ValueError("its contents don't match its checksum")
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path} holds no usable demonstrations ({error}): record them anew") from error
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
