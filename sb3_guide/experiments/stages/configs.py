"""Hyper-parameters, which live in zoo_configs/ only."""

import reprlib
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf
from pathlib import Path
from textwrap import shorten
from types import NoneType
from typing import Any

from stable_baselines3.common.type_aliases import Schedule

from sb3_guide.callbacks.curriculum import falling
from sb3_guide.envs import is_level, level_of
from sb3_guide.envs.batch import MAX_WORLDS
from sb3_guide.files import check_number, fits, read_yaml
from sb3_guide.policies.products import check_arithmetic

PACKAGE = Path(__file__).parents[2]
FOLDERS = (PACKAGE / "zoo_configs", PACKAGE.parent / "zoo_configs")  # inside a wheel, beside the package in a checkout

# What every entry must have: those of cloning, and those of an algorithm of SB3's
OF_CLONING = (
    *("train_episodes", "validation_episodes", "analysis_episodes", "n_epochs", "validate_every", "validate_at"),
    *("batch_size", "learning_rate", "ent_weight"),
)
OF_TRAINING = ("policy", "n_envs", "n_timesteps")
# The largest whole numbers, so that none asks for more memory than a machine has; the least is 1
MOST = {
    **{"n_envs": MAX_WORLDS, "n_steps": 2**18, "batch_size": 2**18, "n_timesteps": 10**12},
    **{"n_epochs": 10**6, "validate_every": 10**6, "validation_episodes": 10**6, "analysis_episodes": 10**6},
    **{"recorded_episodes": 10**7, "train_episodes": 10**7},
}
SCHEDULES = ("learning_rate", "clip_range")
NUMBERS: dict[str, tuple[type, ...]] = {  # and what else each may be
    **dict.fromkeys(("gamma", "gae_lambda", "ent_coef", "vf_coef", "max_grad_norm", "ent_weight"), ()),
    **dict.fromkeys(SCHEDULES, (str,)),
    **dict.fromkeys(("target_kl", "clip_range_vf"), (NoneType,)),
}
HIGHEST = {"gamma": 1, "gae_lambda": 1}
MOST_VALUES = 2**27  # in the observations of a rollout: half a gigabyte as SB3 keeps them

OF_THE_ZOO = ("policy", "n_envs", "n_timesteps", "env_kwargs", "callback")  # keys that rl-zoo itself reads


def algorithm_arguments(config: dict[str, Any]) -> dict[str, Any]:
    """
    :param config: a level's entry in rl-zoo's format
    :return: what of it SB3's algorithm takes by name, "lin_x" being a schedule from x down to 0
    :raises ValueError: if a schedule is of another kind
    """
    return {
        name: schedule(value) if isinstance(value, str) and name in SCHEDULES else value
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


@contextmanager
def in_use(config: dict[str, Any]) -> Iterator[None]:
    """
    Say in one line what a block that is given hyper-parameters can't do with them.

    :param config: a level's entry in rl-zoo's format
    :raises ValueError: instead of what such a block raises
    """
    try:
        yield
    except (ArithmeticError, AssertionError, AttributeError, LookupError, NotImplementedError, TypeError) as error:
        reason = shorten(f"{type(error).__name__}: {error}", 200)
        raise ValueError(f"the hyper-parameters {reprlib.repr(config)} can't be used ({reason})") from error


def load_config(name: str, level: str, file: Path | None = None) -> dict[str, Any]:
    """
    :param name: of a packaged file, such as "ppo" or "bc"
    :param level: name of the level, or id of another environment, whose entry to take
    :param file: YAML in rl-zoo's format to read instead of the packaged one
    :raises FileNotFoundError: if the file does not exist
    :raises ValueError: if it is no YAML mapping or has no usable entry for the level
    """
    path = next(folder for folder in FOLDERS if folder.is_dir()) / f"{name}.yml" if file is None else file
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no file: expected YAML in rl-zoo's format")
    entries = read_yaml(path)
    key = level_of(level).env_id if is_level(level) else level
    if not isinstance(entries, dict) or not isinstance(entries.get(key), dict):
        known = ", ".join(map(str, entries)) if isinstance(entries, dict) else "none"
        raise ValueError(f"{path} has no entry {key}: it has {known}; add one, or give a stage another file with --config")
    config = entries[key]
    if missing := [entry for entry in (OF_CLONING if name == "bc" else OF_TRAINING) if entry not in config]:
        raise ValueError(f"{key} in {path} lacks {', '.join(missing)}")
    return checked(config)


def checked(config: dict[str, Any]) -> dict[str, Any]:
    """
    :param config: a level's entry in rl-zoo's format
    :return: the same, with whole numbers that were written as others, such as 1e6, as such
    :raises ValueError: if something that is to be a number is none, or is out of range
    """
    whole = {name: int(value) for name, value in config.items() if isinstance(value, float) and value.is_integer()}
    config = {**config, **{name: value for name, value in whole.items() if name in MOST}}
    for name, value in config.items():
        if name in MOST:
            check_number(name, value, 1, MOST[name], whole=True)
        elif name in NUMBERS and not isinstance(value, NUMBERS[name]):
            check_number(name, value, most=HIGHEST.get(name, inf))
    if "arithmetic" in config:
        check_arithmetic(config["arithmetic"])
    points = config.get("validate_at", [])
    if not fits(points, list[int | float]) or not all(0 <= point <= MOST["n_epochs"] for point in points):
        raise ValueError(f"validate_at={reprlib.repr(points)}: expected a list of epochs")
    return config
