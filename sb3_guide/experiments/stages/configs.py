"""Hyper-parameters, which live in zoo_configs/ only."""

from pathlib import Path
from typing import Any

import yaml
from stable_baselines3.common.type_aliases import Schedule

from sb3_guide.callbacks.curriculum import falling
from sb3_guide.envs import is_level, level_of

PACKAGE = Path(__file__).parents[2]
FOLDERS = (PACKAGE / "zoo_configs", PACKAGE.parent / "zoo_configs")  # inside a wheel, beside the package in a checkout

OF_THE_ZOO = ("policy", "n_envs", "n_timesteps", "env_kwargs", "callback")  # keys that rl-zoo itself reads


def algorithm_arguments(config: dict[str, Any]) -> dict[str, Any]:
    """
    :param config: a level's entry in rl-zoo's format
    :return: what of it SB3's algorithm takes by name, "lin_x" being a schedule from x down to 0
    :raises ValueError: if a schedule is of another kind
    """
    return {
        name: schedule(value) if isinstance(value, str) and name in ("learning_rate", "clip_range") else value
        for name, value in config.items()
        if name not in OF_THE_ZOO
    }


def schedule(text: str) -> Schedule:
    """
    :param text: such as "lin_0.001"
    :return: a schedule for SB3
    :raises ValueError: if it is of another kind
    """
    start = falling(text)
    return lambda progress_remaining: progress_remaining * start


def load_config(name: str, level: str, file: Path | None = None) -> dict[str, Any]:
    """
    :param name: of a packaged file, such as "ppo" or "bc"
    :param level: name of the level, or id of another environment, whose entry to take
    :param file: YAML in rl-zoo's format to read instead of the packaged one
    :raises FileNotFoundError: if the file does not exist
    :raises ValueError: if it is no YAML mapping or has no entry for the level
    """
    path = next(folder for folder in FOLDERS if folder.is_dir()) / f"{name}.yml" if file is None else file
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist: expected a YAML file in rl-zoo's format")
    try:
        entries = yaml.safe_load(path.read_text())
    except yaml.YAMLError as error:
        raise ValueError(f"{path} is no YAML: {error}") from error
    key = level_of(level).env_id if is_level(level) else level
    if not isinstance(entries, dict) or not isinstance(entries.get(key), dict):
        known = ", ".join(entries) if isinstance(entries, dict) else "none"
        raise ValueError(f"{path} has no entry {key}: it has {known}; add one or pass another file with --config")
    return entries[key]
