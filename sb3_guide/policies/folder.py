"""An agent on disk: a folder with network.safetensors and agent.json."""

from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch as th
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from sb3_guide.files import atomically, read_json, write_json

FORMAT = 1
NETWORK, AGENT = "network.safetensors", "agent.json"


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
    """

    policy: str
    kwargs: dict[str, Any]
    history: int
    level: str | None = None
    versions: dict[str, str] = field(default_factory=dict)
    format: int = FORMAT


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
