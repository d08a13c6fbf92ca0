"""An agent on disk: a folder with network.safetensors and agent.json."""

import math
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from sb3_guide.files import atomically, read_json, write_json

FORMAT = 1
NETWORK, AGENT = "network.safetensors", "agent.json"
LARGEST = 2**24  # values in an observation
ACTIONS = 2**16  # at most


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
    """

    policy: str
    kwargs: dict[str, Any]
    history: int
    level: str | None = None
    versions: dict[str, str] = field(default_factory=dict)
    format: int = FORMAT
    observation_space: dict[str, dict[str, Any]] | None = None
    actions: int | None = None


def package_versions() -> dict[str, str]:
    """:return: versions of the packages that a result depends on"""
    return {name: version(name) for name in ("sb3-guide", "stable-baselines3", "torch", "gymnasium", "numpy", "numba")}


def write_agent(folder: str | Path, description: Description, weights: dict[str, th.Tensor]) -> None:
    """
    Write both files, each atomically, the description last: a folder without it is no agent.

    :param folder: made if need be
    :param description: of the agent
    :param weights: by name
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with atomically(folder / NETWORK) as partial:
        save_file({name: weight.detach().cpu().contiguous() for name, weight in weights.items()}, partial)
    write_json(folder / AGENT, asdict(description))


def read_agent(folder: str | Path) -> tuple[Description, dict[str, th.Tensor]]:
    """
    Read both files; nothing in them can execute code.

    :param folder: of an agent
    :return: its description and its weights by name
    :raises FileNotFoundError: if the folder is no agent's
    :raises ValueError: if a file is damaged or of another format
    """
    folder = Path(folder)
    for name in (AGENT, NETWORK):
        if not (folder / name).is_file():
            raise FileNotFoundError(f"{folder} is no agent's folder, as it lacks {name}: expected one made by save_agent")
    try:
        description = Description(**read_json(folder / AGENT))
    except TypeError as error:
        raise ValueError(f"{folder / AGENT} does not describe an agent: {error}") from error
    if description.format != FORMAT:
        raise ValueError(f"{folder} has format {description.format}: expected {FORMAT}; save the agent anew with this version")
    try:
        return description, load_file(folder / NETWORK)
    except SafetensorError as error:
        raise ValueError(f"{folder / NETWORK} is damaged ({error}): train or copy the agent anew") from error


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
    if not 0 < math.prod(shape) <= LARGEST or np.dtype(dtype).kind not in "buif":
        raise ValueError(f"shape {shape} of {dtype}: expected 1 to {LARGEST} numbers")
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
