"""Pictures for pages: the world, and the agent's view of it."""

import io
from base64 import b64encode

import numpy as np
from gymnasium import spaces
from PIL import Image

from sb3_guide.envs.engine.cells import VIEW
from sb3_guide.envs.rendering import TILE, draw_tile
from sb3_guide.policies.picture import picture_of

UP, NOBODY = 3, 4  # the agent always looks up in its own view
SIDE = 224  # pixels that small images are enlarged to, about


def draw_view(image: np.ndarray) -> np.ndarray:
    """
    Draw what the agent sees, itself in the middle below with what it carries beside its tip.

    :param image: (7, 7, 3) uint8 of an observation, first across the view, then from far to near
    :return: (224, 224, 3) uint8; what is hidden is dark
    """
    kind, colour, state = image.astype(int).transpose(2, 1, 0)  # (7, 7) each, rows from far to near
    cells = kind | colour << 3 | state << 6
    view = np.zeros((VIEW, VIEW, TILE, TILE, 3), dtype=np.uint8)
    for row, column in np.ndindex(VIEW, VIEW):
        own = (row, column) == (VIEW - 1, VIEW // 2)
        view[row, column] = draw_tile(int(cells[row, column]), UP if own else NOBODY, bool(kind[row, column]))
    return view.transpose(0, 2, 1, 3, 4).reshape(VIEW * TILE, VIEW * TILE, 3)


def draw_image(image: np.ndarray, seen: spaces.Dict) -> np.ndarray:
    """
    Draw what an agent sees in an environment that is not ours: pixels as they are, and cells in false colours, their first
    three channels being red, green and blue.

    :param image: of an observation, channels last, or first if the agent's space has them first and the environment did too
    :param seen: observation space of the agent
    :return: (height, width, 3) uint8
    """
    picture = picture_of(seen)
    if picture.channels_first and image.shape == seen["image"].shape:
        image = np.moveaxis(image, 0, -1)
    brightest = picture.scale if picture.values is None else max(int(image.max()), 1)
    channels = np.repeat(image, 3, axis=2) if picture.channels == 1 else image[:, :, :3]
    shades = np.zeros((*image.shape[:2], 3), dtype=np.uint8)
    shades[:, :, : channels.shape[2]] = (channels / brightest).clip(0, 1) * 255
    return np.kron(shades, np.ones((max(1, SIDE // max(image.shape[:2])),) * 2 + (1,), dtype=np.uint8))


def data_url(picture: np.ndarray) -> str:
    """
    :param picture: (height, width, 3) uint8
    :return: address that holds it
    """
    file = io.BytesIO()
    Image.fromarray(picture).convert("P", palette=Image.Palette.ADAPTIVE).save(file, "PNG", optimize=True)
    return f"data:image/png;base64,{b64encode(file.getvalue()).decode()}"
