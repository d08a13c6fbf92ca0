"""Where the target lies in the view."""

import numpy as np
import pytest

from sb3_guide.cloning import Episodes
from sb3_guide.envs.vocabulary import encode
from sb3_guide.language import SITUATIONS, meanings, situations, targets

EMPTY, BALL, KEY = (1, 0, 0), (6, 0, 0), (5, 2, 0)  # a red ball, a blue key


def episode(mission: str, *frames: dict[tuple[int, int], tuple[int, int, int]]) -> Episodes:
    """One episode whose frames hold these objects, by column and row of the view."""
    images = np.full((len(frames), 7, 7, 3), EMPTY, dtype=np.uint8)
    for image, objects in zip(images, frames, strict=True):
        for place, cell in objects.items():
            image[place] = cell
    actions, offsets = np.zeros(len(frames), dtype=np.uint8), np.array([0, len(frames)])
    return Episodes(images, actions, encode(mission)[None], offsets, np.ones(1), np.zeros(1, dtype=np.int64))


@pytest.mark.parametrize(
    ("place", "expected"),
    [((3, 2), "ahead"), ((0, 6), "left"), ((5, 6), "right"), (None, "not visible"), ((1, 1), None)],
)
def test_the_four_situations_of_the_paper(place, expected):
    played = episode("go to the red ball", {place: BALL} if place else {})
    found = situations(targets(played))
    assert found.tolist() == [-1 if expected is None else SITUATIONS.index(expected)]


def test_other_types_and_colours_are_no_targets():
    played = episode("go to the red ball", {(3, 2): (6, 1, 0), (3, 3): (5, 0, 0), (2, 2): BALL})
    assert np.argwhere(targets(played)[0]).tolist() == [[2, 2]]


def test_a_mission_may_leave_the_colour_or_the_type_open():
    view = {(3, 2): BALL, (2, 2): (6, 3, 0), (1, 1): KEY}
    assert targets(episode("go to the ball", view))[0].sum() == 2
    assert np.argwhere(targets(episode("go to a blue object".replace("object", "key"), view))[0]).tolist() == [[1, 1]]


def test_what_is_carried_is_no_target_and_where_it_goes_is():
    mission = "put the red ball next to the blue key"
    before, after = {(3, 5): BALL, (0, 6): KEY}, {(3, 6): BALL, (0, 6): KEY}
    assert [np.argwhere(frame).tolist() for frame in targets(episode(mission, before, after))] == [[[3, 5]], [[0, 6]]]


def test_meanings_are_about_the_nearest_target_and_what_it_is():
    mission, red, ball = "go to the red ball", 0 + 1, 6 + 1  # colour and type from 0, which stands for any
    played = episode(mission, {(3, 2): BALL, (1, 5): BALL, (3, 5): KEY}, {})
    assert meanings(played, targets(played)).tolist() == [[1, 5, ball, red], [7, 7, ball, red]]
