"""Pictures for pages: the world, and the agent's view of it."""

import io
from base64 import b64encode

import numpy as np
from PIL import Image

from sb3_guide.envs.engine.cells import VIEW
from sb3_guide.envs.rendering import TILE, draw_tile

UP, NOBODY = 3, 4  # the agent always looks up in its own view


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


def data_url(picture: np.ndarray) -> str:
    """
    :param picture: (height, width, 3) uint8
    :return: address that holds it
    """
    file = io.BytesIO()
    Image.fromarray(picture).convert("P", palette=Image.Palette.ADAPTIVE).save(file, "PNG", optimize=True)
    return f"data:image/png;base64,{b64encode(file.getvalue()).decode()}"
