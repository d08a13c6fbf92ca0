"""An agent on disk: a folder with network.safetensors and agent.json, which holds a checksum over both."""

import math
import reprlib
import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces

from sb3_guide.files import check_types, checksum, fits, read_arrays, read_json, write_arrays, write_json
from sb3_guide.policies.picture import ACTIONS

FORMAT = 2
WITHOUT_CHECKSUM = 1  # the format before
NETWORK, AGENT = "network.safetensors", "agent.json"
MOST_BYTES = 2**30  # of weights
LARGEST = 2**23  # values in an observation


@dataclass(frozen=True)
class Description:
    """
    What agent.json says.

    :param policy: name of the policy's class
    :param kwargs: arguments that build the policy anew, all of them JSON
    :param history: images before the present one in its observation space
    :param level: where it was trained
    :param versions: of the packages it was made with
    :param format: of the folder
    :param observation_space: as :func:`described` returns it; None for that of our levels
    :param actions: how many there are; None for those of our levels
    :raises TypeError: if one of them is of another type
    """

    policy: str
    kwargs: dict[str, Any]
    history: int
    level: str | None = None
    versions: dict[str, str] = field(default_factory=dict)
    format: int = FORMAT
    observation_space: dict[str, dict[str, Any]] | None = None
    actions: int | None = None

    def __post_init__(self) -> None:
        check_types(self)


def package_versions() -> dict[str, str]:
    """:return: versions of the packages that a result depends on"""
    return {name: version(name) for name in ("sb3-guide", "stable-baselines3", "torch", "gymnasium", "numpy", "numba")}


def write_agent(folder: str | Path, description: Description, weights: dict[str, th.Tensor]) -> None:
    """
    Write both files, each atomically, the description last: a folder without it, or with another's, is no agent.

    :param folder: made if need be
    :param description: of the agent
    :param weights: by name
    :raises ValueError: if a weight is not finite
    """
    folder = Path(folder)
    arrays = {name: weight.detach().cpu().numpy() for name, weight in weights.items()}
    check_finite(arrays, folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_arrays(folder / NETWORK, arrays)
    content = asdict(replace(description, format=FORMAT))
    write_json(folder / AGENT, {**content, "sha256": checksum(arrays, content)})


def read_agent(folder: str | Path) -> tuple[Description, dict[str, th.Tensor]]:
    """
    Read both files; nothing in them can execute code. A folder of an earlier version, without checksum, is read with a
    warning.

    :param folder: of an agent
    :return: its description and its weights by name
    :raises FileNotFoundError: if the folder is no agent's
    :raises ValueError: if a file is damaged or of another format, or a weight is not finite
    """
    folder = Path(folder)
    for name in (AGENT, NETWORK):
        if not (folder / name).is_file():
            raise FileNotFoundError(f"{folder} is no agent's folder, as it lacks {name}: expected one made by save_agent")
    content = read_json(folder / AGENT)
    expected = content.pop("sha256", None)
    try:
        description = Description(**content)
    except TypeError as error:
        raise ValueError(f"{folder / AGENT} does not describe an agent: {error}") from error
    if description.format not in (FORMAT, WITHOUT_CHECKSUM):
        raise ValueError(f"{folder} has format {description.format}: expected {FORMAT}; save the agent anew with this version")
    if (size := (folder / NETWORK).stat().st_size) > MOST_BYTES:
        raise ValueError(f"{folder / NETWORK} has {size} bytes: expected at most {MOST_BYTES}")
    arrays, _ = read_arrays(folder / NETWORK)
    if description.format == WITHOUT_CHECKSUM:
        warnings.warn(
            f"{folder} is of an earlier version and has no checksum: make sure of where it is from, and save it anew with "
            "save_agent(load_agent(folder), folder)",
            stacklevel=2,
        )
    elif checksum(arrays, content) != expected:
        raise ValueError(f"{folder} is damaged: its files don't match its checksum; train or copy the agent anew")
    check_finite(arrays, folder)
    return description, {name: th.from_numpy(array) for name, array in arrays.items()}


def check_finite(arrays: Mapping[str, np.ndarray], folder: Path) -> None:
    """
    :param arrays: weights by name
    :param folder: of the agent
    :raises ValueError: if one is not finite
    """
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise ValueError(f"{name} of the agent in {folder} is not finite: its training diverged; take smaller steps")


def described(space: spaces.Dict) -> dict[str, dict[str, Any]]:
    """
    :param space: of Boxes
    :return: the same as JSON; bounds that are the same everywhere are written once
    """
    return {
        name: {"shape": list(box.shape), "dtype": str(box.dtype), "low": bounds(box.low), "high": bounds(box.high)}
        for name, box in space.spaces.items()
        if isinstance(box, spaces.Box)
    }


def bounds(values: np.ndarray) -> Any:
    """:return: a number, where all are the same, or nested lists of numbers"""
    return (values.flat[0] if (values == values.flat[0]).all() else values).tolist()


def space_of(description: dict[str, dict[str, Any]]) -> spaces.Dict:
    """
    :param description: as :func:`described` returns it
    :raises ValueError: if it describes no Boxes
    """
    try:
        return spaces.Dict({name: box_of(**box) for name, box in description.items()})
    except (AssertionError, AttributeError, OverflowError, TypeError, ValueError) as error:
        raise ValueError(f"agent.json describes no observation space ({error!r})") from error


def box_of(shape: list[int], dtype: str, low: Any, high: Any) -> spaces.Box:
    """
    :param shape: of the arrays
    :param dtype: of their values
    :param low: see :func:`bounds`
    :param high: see :func:`bounds`
    :raises ValueError: if there is no such Box, or it is larger than anything that agents see
    """
    if not fits(shape, list[int]) or not 0 < math.prod(shape) <= LARGEST or np.dtype(dtype).kind not in "buif":
        raise ValueError(f"shape {reprlib.repr(shape)} of {dtype}: expected 1 to {LARGEST} numbers")
    kind = np.dtype(dtype).type
    lowest, highest = (np.broadcast_to(np.array(bound, kind), shape) for bound in (low, high))
    return spaces.Box(lowest, highest, tuple(shape), kind)


def actions_of(count: Any) -> spaces.Discrete:
    """
    :param count: of actions, as agent.json has it
    :raises ValueError: if there can't be so many
    """
    if not isinstance(count, int) or not 1 <= count <= ACTIONS:
        raise ValueError(f"agent.json tells of {count!r} actions: expected 1 to {ACTIONS}")
    return spaces.Discrete(count)
