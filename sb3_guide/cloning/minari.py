"""Demonstrations as datasets of Minari, and back."""

import json
import re
import shutil
from collections.abc import Iterator
from copy import deepcopy
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium
import h5py
import numpy as np
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_dataset import parse_dataset_id
from minari.dataset.minari_storage import MinariStorage
from minari.namespace import create_namespace, list_local_namespaces
from minari.storage import get_dataset_path

from sb3_guide.cloning.demonstrations import Demonstrations
from sb3_guide.cloning.exchange import NO_SEED, WholeEpisode, demonstrations_of, whole_episodes
from sb3_guide.envs import encode, level_of

FORMAT = "hdf5"  # no code can hide in it
OURS = "sb3_guide"  # where the provenance is in a dataset's metadata
HIGHEST_RATIO = 1000  # of an array's size to its size on disk, compressed as well as HDF5 can
ENV_ID = re.compile(r"(?:GuideGrid|BabyAI)-(\w+)-v0")


def save_minari(demonstrations: Demonstrations, dataset_id: str) -> None:
    """
    Write a dataset among Minari's local ones, where ``minari.load_dataset(dataset_id)`` finds it. Every episode is played
    again for its rewards and last observation. The dataset is there when it is whole.

    :param demonstrations: of one level
    :param dataset_id: such as "guidegrid/GoToLocal/expert-v0"
    :raises ValueError: see :func:`free_place`, or if an episode is another one when it is played again
    """
    folder = free_place(demonstrations.level, dataset_id)
    namespace, name = parsed(dataset_id)
    if namespace and namespace not in list_local_namespaces():
        create_namespace(namespace)
    partial = folder.with_name(f".{name}.partial")  # Minari lists no hidden folders
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    spec = deepcopy(gymnasium.spec(level_of(demonstrations.level).env_id))
    spec.kwargs["history"] = 0  # so that the env that Minari recovers has the observations of the dataset
    storage = MinariStorage.new(partial / "data", env_spec=spec, data_format=FORMAT)
    storage.update_metadata(
        {
            "dataset_id": dataset_id,
            "minari_version": version("minari"),
            "description": f"Successful episodes of {demonstrations.level}. Level and seed of an episode give its world.",
            "requirements": [f"sb3-guide=={version('sb3-guide')}"],
            OURS: demonstrations.provenance,
        }
    )
    storage.update_episodes(map(_buffer, whole_episodes(demonstrations)))
    partial.rename(folder)


def free_place(level: str, dataset_id: str) -> Path:
    """
    To be called before demonstrations are made for a dataset, which takes long.

    :param level: of the demonstrations
    :param dataset_id: of the dataset to make of them
    :return: its folder
    :raises ValueError: if the level is none of ours, or the id is none or taken
    """
    parsed(dataset_id)
    level_of(level)
    folder = get_dataset_path(dataset_id)
    if folder.exists():
        raise ValueError(f"there is a dataset {dataset_id} already: expected a new name or version, or delete it with Minari")
    return folder


def _buffer(whole: WholeEpisode) -> EpisodeBuffer:
    return EpisodeBuffer(
        seed=whole.seed,
        observations=whole.observations,
        actions=whole.actions,
        rewards=whole.rewards,
        terminations=whole.terminations,
        truncations=whole.truncations,
        infos={},
    )


def load_minari(dataset_id: str) -> Demonstrations:
    """
    Read a local dataset: one of :func:`save_minari`, or of Minigrid's BabyAI levels with their partial view. Failed episodes
    are left out. Nothing in a dataset is run, whereas Minari itself makes the environment that a dataset names if its
    description lacks a space.

    :param dataset_id: such as "guidegrid/GoToLocal/expert-v0"
    :raises FileNotFoundError: if there is no such dataset
    :raises ValueError: if it is damaged, or not of our levels
    """
    parsed(dataset_id)
    folder = get_dataset_path(dataset_id) / "data"
    if not (folder / "metadata.json").is_file():
        raise FileNotFoundError(f"there is no dataset {dataset_id} at {folder}: expected one that 'minari list local' lists")
    try:
        metadata = MinariStorage.read_raw_metadata(folder)
        if not {"observation_space", "action_space"} <= metadata.keys() or metadata.get("data_format") != FORMAT:
            raise ValueError(f"expected the spaces of observations and actions in its metadata.json, and data_format {FORMAT}")
        env_id = json.loads(metadata["env_spec"])["id"]
        level = ENV_ID.fullmatch(env_id)
        if level is None:
            raise ValueError(f"it is of {env_id}: expected a level of GuideGrid or BabyAI")
        check_size(folder / "main_data.hdf5")
        storage = MinariStorage.read(folder)
        return demonstrations_of(_wholes(storage), level[1], metadata.get(OURS, {"minari": dataset_id}))
    except (AssertionError, KeyError, OSError, RuntimeError, TypeError, ValueError) as error:
        raise ValueError(f"the dataset {dataset_id} holds no usable demonstrations ({error})") from error


def check_size(path: Path) -> None:
    """
    Look at what a file promises before any memory is taken for it.

    :param path: of an HDF5 file
    :raises ValueError: if its arrays can't be in a file of its size
    """
    sizes: list[int] = []
    with h5py.File(path) as file:
        file.visititems(lambda _, item: sizes.append(item.nbytes) if isinstance(item, h5py.Dataset) else None)
    if sum(sizes) > HIGHEST_RATIO * path.stat().st_size:
        raise ValueError(f"{path.name} of {path.stat().st_size} bytes promises arrays of {sum(sizes)} bytes")


def _wholes(storage: MinariStorage) -> Iterator[WholeEpisode]:
    numbers = range(storage.total_episodes)
    for episode, metadata in zip(storage.get_episodes(numbers), storage.get_episode_metadata(numbers), strict=True):
        yield WholeEpisode(
            observations={
                "image": episode["observations"]["image"],
                "mission": _tokens(episode["observations"]["mission"]),
            },
            actions=episode["actions"],
            rewards=episode["rewards"],
            terminations=episode["terminations"],
            truncations=episode["truncations"],
            seed=metadata.get("seed", NO_SEED),
        )


def _tokens(missions: Any) -> np.ndarray:
    """:return: (T + 1, 72) uint8 of missions that are tokens or, as Minigrid's, texts"""
    return np.stack([encode(text) for text in missions]) if isinstance(missions, list) else missions


def parsed(dataset_id: str) -> tuple[str | None, str]:
    """
    :param dataset_id: of a dataset
    :return: its namespace, if any, and the rest of it
    :raises ValueError: if it is none of Minari's ids
    """
    try:
        namespace, *_ = parse_dataset_id(dataset_id)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{dataset_id!r} is no id of Minari: expected such as guidegrid/GoToLocal/expert-v0") from error
    return namespace, dataset_id.rpartition("/")[2]
