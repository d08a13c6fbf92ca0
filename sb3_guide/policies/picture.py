"""What an observation space says about its image and its missions, and whether agents can live there."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch as th
from gymnasium import spaces

PIXELS = 36  # on the shorter side, from which on bytes are colours; they are numbers of what lies in a cell below
CELL_VALUES = 256  # that a channel of a cell may take
CELLS = 128 * 128  # that one kernel may look at
WORDS, ACTIONS = 2**16, 2**14


class Picture(NamedTuple):
    """
    Form of all images of an environment.

    :param height: rows
    :param width: columns
    :param values: how many values each channel of a cell can take; of pixels, which are measured, None
    :param channels: of each cell or pixel
    :param scale: largest magnitude of a pixel
    :param channels_first: images are (channels, height, width), as SB3 turns those that it takes for pictures
    """

    height: int
    width: int
    channels: int
    values: tuple[int, ...] | None
    scale: float
    channels_first: bool


def picture_of(observation_space: spaces.Space) -> Picture:
    """
    Cells, which are looked up, or pixels, which are measured: pixels are floats, and bytes from 0 to 255 in images of at least
    36 x 36.

    :param observation_space: of the agent
    :raises ValueError: if there is no image that an agent can see
    """
    image = observation_space.spaces.get("image") if isinstance(observation_space, spaces.Dict) else None
    if not isinstance(image, spaces.Box) or len(image.shape) != 3:
        raise ValueError(
            "the observation space has no image: expected a Dict with 'image', a Box of (height, width, channels), and, where "
            f"there are missions, 'mission', got {observation_space}"
        )
    bytes_ = image.dtype == np.uint8 and (image.low == 0).all() and (image.high == 255).all()
    pixels = np.issubdtype(image.dtype, np.floating) or (bytes_ and min(sorted(image.shape)[1:]) >= PIXELS)
    # SB3 turns no picture whose channels are not the fewest
    channels_first = bool((bytes_ or pixels) and image.shape[0] < min(image.shape[1:]))
    channels, height, width = image.shape if channels_first else np.roll(image.shape, 1).tolist()
    if pixels:
        if not (np.isfinite(image.low).all() and np.isfinite(image.high).all()):
            raise ValueError(f"the image's values have no bounds: expected floats between bounds such as 0 and 1, got {image}")
        scale = float(max(np.abs(image.low).max(), np.abs(image.high).max())) or 1.0
        return Picture(height, width, channels, None, scale, channels_first)
    if height * width > CELLS:
        raise ValueError(f"the image has {height} x {width} cells: expected at most {CELLS}, or pixels as floats")
    highest = image.high.max(axis=(1, 2) if channels_first else (0, 1)).astype(np.int64)  # (channels,)
    if image.low.min() < 0 or highest.max() >= CELL_VALUES:
        raise ValueError(
            f"the image's cells go from {image.low.min()} to {highest.max()}: expected integers from 0 to at most "
            f"{CELL_VALUES - 1}, or pixels as floats, got {image}"
        )
    return Picture(height, width, channels, tuple((highest + 1).tolist()), 1.0, channels_first)


def words_of(observation_space: spaces.Dict) -> int:
    """
    :param observation_space: of the agent
    :return: number of word ids, 0 being padding; 1 where there are no missions
    :raises ValueError: if missions are no tokens
    """
    mission = observation_space.spaces.get("mission")
    if mission is None:
        return 1
    row = isinstance(mission, spaces.Box) and len(mission.shape) == 1 and np.issubdtype(mission.dtype, np.integer)
    if not isinstance(mission, spaces.Box) or not row or mission.low.min() < 0 or mission.high.max() >= WORDS:
        raise ValueError(
            f"the mission is no row of tokens: expected a Box of integers from 0 (padding) to at most {WORDS - 1}, got "
            f"{mission}; sb3_guide.envs.TextMissionWrapper makes tokens of text"
        )
    return int(mission.high.max()) + 1


def check_spaces(observation_space: spaces.Space, action_space: spaces.Space) -> None:
    """
    :raises ValueError: if agents can't see or act there; the message says what is missing
    """
    picture_of(observation_space)
    assert isinstance(observation_space, spaces.Dict)
    words_of(observation_space)
    image, history = observation_space["image"], observation_space.spaces.get("history")
    if history is not None and (history.shape is None or sorted(history.shape[1:]) != sorted(image.shape or ())):
        raise ValueError(f"the history is {history}: expected (images, ...) of the image's shape {image.shape}")
    if unknown := sorted(observation_space.spaces.keys() - {"image", "mission", "history"}):
        raise ValueError(
            f"agents see image, mission and history, and no {', '.join(unknown)}: leave it out of the observations by a "
            "wrapper, as sb3_guide.envs.TextMissionWrapper does"
        )
    if not isinstance(action_space, spaces.Discrete) or action_space.start != 0 or action_space.n > ACTIONS:
        raise ValueError(f"the actions are {action_space}: expected a Discrete space of at most {ACTIONS} that starts at 0")


def check_values(what: str, values: th.Tensor, counts: Sequence[int]) -> None:
    """
    :param what: is observed, in the plural
    :param values: (N, ..., C) of it
    :param counts: (C,) how many there may be: the whole numbers from 0 on
    :raises ValueError: if there are others
    """
    # row by row first, which torch does several at once; as numbers, for 256 is 0 to a tensor of bytes
    highest = values.flatten(1).amax(dim=0).reshape(-1, len(counts)).amax(dim=0)
    low = 0 if values.dtype == th.uint8 else values.amin().item()
    broken = values.is_floating_point() and values.frac().any()
    for high, count in zip(highest.cpu().tolist(), counts, strict=True):
        if low < 0 or high >= count or broken:
            raise ValueError(
                f"{what} have values from {low:.3g} to {high:.3g}: expected whole numbers from 0 to {count - 1}, as the "
                "observation space says; VecNormalize needs norm_obs=False before an agent"
            )
