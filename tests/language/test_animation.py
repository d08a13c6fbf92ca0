from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sb3_guide.language.animation import MAX_FRAMES, WIDTH, Caption, draw_frame, write_animation

CAPTION = Caption("go to the red ball", "w0 w2", "forward")


def frames(number: int, cells: int = 8) -> list[np.ndarray]:
    """A grid of coloured cells, of which a row of seven is lit, another one in each frame."""
    grid = np.random.default_rng(0).integers(0, 4, (cells, cells, 3), np.uint8) * np.uint8(60)
    grids = np.tile(grid, (number, 1, 1, 1))
    grids[np.arange(number), np.arange(number) % cells, :7] += np.uint8(60)
    return list(grids.repeat(32, axis=1).repeat(32, axis=2))


def test_a_gif_shows_every_frame_and_the_last_one_longer(tmp_path: Path) -> None:
    write_animation(tmp_path / "episode.gif", frames(5), [CAPTION] * 5)
    durations = []
    with Image.open(tmp_path / "episode.gif") as picture:
        assert picture.format == "GIF"
        assert picture.info["loop"] == 0
        for index in range(picture.n_frames):
            picture.seek(index)
            durations.append(picture.info["duration"])
    assert durations == [500] * 4 + [2000]
    assert list(tmp_path.iterdir()) == [tmp_path / "episode.gif"]


def test_a_long_episode_stays_below_a_megabyte(tmp_path: Path) -> None:
    write_animation(tmp_path / "episode.gif", frames(300, cells=22), [CAPTION] * 300)
    assert (tmp_path / "episode.gif").stat().st_size < 1_000_000
    with Image.open(tmp_path / "episode.gif") as picture:
        assert picture.n_frames <= MAX_FRAMES


@pytest.mark.parametrize("shape", [(256, 256, 3), (704, 704, 3), (40, 80, 3)])
def test_every_picture_has_the_same_size(shape: tuple[int, ...]) -> None:
    picture = draw_frame(np.zeros(shape, np.uint8), CAPTION)
    assert picture.size == draw_frame(frames(1)[0], CAPTION).size
    assert picture.width == WIDTH


@pytest.mark.parametrize(
    "other",
    [
        CAPTION._replace(mission="go to the red key"),
        CAPTION._replace(message="w1 w1"),
        CAPTION._replace(message=""),
        CAPTION._replace(action="left"),
    ],
)
def test_mission_message_and_action_can_be_read(other: Caption) -> None:
    frame = frames(1)[0]
    assert draw_frame(frame, CAPTION).tobytes() != draw_frame(frame, other).tobytes()


def test_the_longest_mission_leaves_the_message_readable() -> None:
    frame, mission = (
        frames(1)[0],
        "pick up the grey box behind you, then go to a red door " * 5,
    )
    lines = [np.asarray(draw_frame(frame, CAPTION._replace(mission=text)))[WIDTH + 74 :] for text in (mission, "go")]
    np.testing.assert_array_equal(lines[0], lines[1])


@pytest.mark.parametrize(
    ("pictures", "captions"),
    [([], []), (frames(2), [CAPTION]), ([np.zeros((8, 8), np.uint8)], [CAPTION]), ([np.zeros((8, 8, 3))], [CAPTION])],
)
def test_wrong_frames_are_refused(pictures: list[np.ndarray], captions: list[Caption], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="frame"):
        write_animation(tmp_path / "episode.gif", pictures, captions)
    assert not list(tmp_path.iterdir())
