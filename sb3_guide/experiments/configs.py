"""Hyper-parameters, which live in zoo_configs/ only."""

from pathlib import Path
from typing import Any

import yaml

from sb3_guide.envs import level_of

PACKAGE = Path(__file__).parents[1]
FOLDERS = (PACKAGE / "zoo_configs", PACKAGE.parent / "zoo_configs")  # inside a wheel, beside the package in a checkout


def load_config(name: str, level: str, file: Path | None = None) -> dict[str, Any]:
    """
    :param name: of a packaged file: "ppo" or "bc"
    :param level: whose entry to take
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
    key = level_of(level).env_id
    if not isinstance(entries, dict) or not isinstance(entries.get(key), dict):
        known = ", ".join(entries) if isinstance(entries, dict) else "none"
        raise ValueError(f"{path} has no entry {key}: it has {known}; add one or pass another file with --config")
    return entries[key]
