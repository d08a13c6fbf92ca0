"""Where the object that the mission names lies in the agent's view (paper section 5.2)."""

import numpy as np

from sb3_guide.cloning.episodes import Episodes
from sb3_guide.envs.engine.cells import BALL, BOX, COLOURS, DOOR, KEY, VIEW
from sb3_guide.envs.vocabulary import WORDS

#: where an object of the mission's may be, seen from the agent (paper section 5.2)
SITUATIONS = ("ahead", "left", "right", "not visible")
ELSEWHERE = -1  # visible, but neither straight ahead nor beside the agent: none of the paper's situations
COLUMN, ROW = VIEW // 2, VIEW - 1  # the agent's own, in the middle below
TYPES = {"door": DOOR, "key": KEY, "ball": BALL, "box": BOX}
ANYTHING = -1  # type or colour that the mission leaves open


def targets(episodes: Episodes) -> np.ndarray:
    """
    The cells that hold an object as the mission describes it, by type and colour: the one to go to or to pick up, and of "put
    A next to B" A until it is carried, B from then on. Places such as "on your left", which hold where the episode began, are
    left out, so of several objects that look alike all count.

    :param episodes: E of them, of F frames in all, of levels with one clause a mission
    :return: (F, 7, 7) bool, first across the view, then from far to near
    """
    kind, colour = sought(episodes).T
    seen = episodes.images[..., :2].astype(int)
    same_kind = (seen[..., 0] == kind[:, None, None]) | (kind == ANYTHING)[:, None, None]
    same_colour = (seen[..., 1] == colour[:, None, None]) | (colour == ANYTHING)[:, None, None]
    found = np.isin(seen[..., 0], list(TYPES.values())) & same_kind & same_colour
    found[:, COLUMN, ROW] = False  # what the agent carries
    return found


def sought(episodes: Episodes) -> np.ndarray:
    """:return: (F, 2) int64 type and colour of what each frame is about, a value of the image or ANYTHING"""
    described = np.array([descriptions(mission) for mission in episodes.missions])  # (E, 2, 2)
    of_frame = np.repeat(described, episodes.lengths, axis=0)
    carries = np.isin(episodes.images[:, COLUMN, ROW, 0], (KEY, BALL, BOX))
    return of_frame[np.arange(len(carries)), carries.astype(int)]


def descriptions(mission: np.ndarray) -> list[list[int]]:
    """
    :param mission: (72,) tokens of a mission with one clause
    :return: type and colour, each a value of the image or ANYTHING, of its first object and of its second, or the first again
    """
    words, found = [WORDS[token] for token in mission if token], []
    for position, word in enumerate(words):
        if word in ("the", "a"):
            described = words[position + 1 : position + 3]
            colour = next((COLOURS.index(name) for name in described if name in COLOURS), ANYTHING)
            found.append([next((TYPES[name] for name in described if name in TYPES), ANYTHING), colour])
    return [found[0], found[-1]]


def situations(found: np.ndarray) -> np.ndarray:
    """
    The paper's situations, as its published code has them: a target in the agent's column is ahead, one on its row to the left
    or right, one that is visible elsewhere in none of them. Of several that hold, the first in the order of SITUATIONS counts.

    :param found: (F, 7, 7) bool, as :func:`targets` returns it
    :return: (F,) int64, index into SITUATIONS, or ELSEWHERE
    """
    holds = np.stack(
        [
            found[:, COLUMN].any(axis=1),
            found[:, :COLUMN, ROW].any(axis=1),
            found[:, COLUMN + 1 :, ROW].any(axis=1),
            ~found.any(axis=(1, 2)),
        ],
        axis=1,
    )
    return np.where(holds.any(axis=1), holds.argmax(axis=1), ELSEWHERE)


def meanings(episodes: Episodes, found: np.ndarray) -> np.ndarray:
    """
    What a message could be about, as attributes: where the nearest target is, and what it is.

    :param episodes: of F frames
    :param found: (F, 7, 7) bool, as :func:`targets` returns it
    :return: (F, 4) int64 from 0: column and row of the target, 7 where none is visible, and type and colour in the mission
    """
    across, down = np.indices((VIEW, VIEW))
    steps = np.where(found, np.abs(across - COLUMN) + ROW - down, 2 * VIEW).reshape(len(found), -1)
    place = np.stack(np.divmod(steps.argmin(axis=1), VIEW), axis=1)
    visible = found.reshape(len(found), -1).any(axis=1, keepdims=True)
    return np.concatenate([np.where(visible, place, VIEW), sought(episodes) - ANYTHING], axis=1)
