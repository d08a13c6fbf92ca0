"""An episode as a GIF: the grid, and beneath it the mission, the message that was heard and the action that was taken."""

import io
import textwrap
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont, ImageOps

from sb3_guide.envs import GuideGridEnv, is_level
from sb3_guide.files import atomically
from sb3_guide.language.reading import Reading

SHOWN_LENGTH = 8  # frames that an episode needs to be worth watching
WIDTH = 320  # pixels; the grid is scaled to a square of this side
PANEL = 132  # pixels of text beneath the grid
MILLISECONDS = 500  # that a frame stays; the last one stays four times as long
MAX_FRAMES = 100  # keeps a maze of 22 x 22 cells under 1 MB
COLOURS = 96  # of the palette, shared by all frames
BACKGROUND, FAINT, TEXT, MESSAGE, ACTION = "#16181d", "#9aa3b2", "#f2f4f8", "#f0a15e", "#7cc4f5"
MISSION_COLUMNS = 38  # characters that fit a line


class Caption(NamedTuple):
    """
    What is written beneath one frame.

    :param mission: instruction of the episode
    :param message: that the agent heard at this frame, such as "w0 w2"; empty if there was none
    :param action: that the agent then took; empty after the last one
    """

    mission: str
    message: str
    action: str


def worth_watching(reading: Reading) -> int:
    """:return: index of the first successful episode that is long enough to be worth watching, or of the longest one"""
    lengths = np.where(reading.episodes.successes, reading.episodes.lengths, 0)
    return int(np.argmax(lengths.clip(max=SHOWN_LENGTH)))


def replay(reading: Reading, level: str, episode: int) -> tuple[list[Any], list[Caption]] | None:
    """
    :param reading: of episodes that were played there
    :param level: name or id of the level, or id of another environment
    :param episode: index of the one to show
    :return: pictures before each action and after the last one, and what to write beneath them; None if the environment does
        not draw itself
    """
    episodes, names, env = reading.episodes, reading.shape.names(), drawn(level)
    if env is None:
        return None
    first, last = episodes.offsets[episode : episode + 2]
    env.reset(seed=int(episodes.seeds[episode]))
    mission = getattr(env.unwrapped, "mission", "")
    frames: list[Any] = []
    captions = []
    for message, action in zip(reading.messages[first:last], episodes.actions[first:last], strict=True):
        frames.append(env.render())
        captions.append(Caption(mission, names[message], reading.actions[action]))
        env.step(action)
    frames.append(env.render())
    captions.append(Caption(mission, "", ""))
    env.close()
    return frames, captions


def drawn(level: str) -> gymnasium.Env | None:
    """:return: an environment that draws itself, None if it can't"""
    if is_level(level):
        return GuideGridEnv(level, render_mode="rgb_array")
    with closing(gymnasium.make(level)) as env:
        if "rgb_array" not in (env.metadata.get("render_modes") or ()):
            return None
    try:
        return gymnasium.make(level, render_mode="rgb_array")
    except TypeError:  # what makes it takes no render mode
        return None


def write_animation(path: Path, frames: Sequence[np.ndarray], captions: Sequence[Caption]) -> None:
    """
    Write :func:`animation` to a file atomically.

    :param path: of the GIF; its folder must exist
    """
    content = animation(frames, captions)
    with atomically(path) as partial:
        partial.write_bytes(content)


def animation(frames: Sequence[np.ndarray], captions: Sequence[Caption]) -> bytes:
    """
    A GIF, in our levels of at most 1 MB. Of an episode longer than MAX_FRAMES, evenly spaced frames are shown.

    :param frames: of one episode, each (height, width, 3) uint8, square cells
    :param captions: one a frame
    :return: content of the file
    :raises ValueError: if there is no frame, captions and frames differ in number, or a frame is no RGB picture
    """
    if not frames or len(frames) != len(captions):
        raise ValueError(f"An animation needs frames and as many captions: got {len(frames)} frames, {len(captions)} captions")
    chosen = np.linspace(0, len(frames) - 1, min(len(frames), MAX_FRAMES)).round().astype(int)
    pictures = share_palette([draw_frame(frames[index], captions[index]) for index in chosen])
    durations = [MILLISECONDS] * (len(pictures) - 1) + [4 * MILLISECONDS]
    file = io.BytesIO()
    pictures[0].save(file, "GIF", save_all=True, append_images=pictures[1:], duration=durations, loop=0)
    return file.getvalue()


def draw_frame(frame: np.ndarray, caption: Caption) -> Image.Image:
    """
    :param frame: (height, width, 3) uint8
    :param caption: of this frame
    :return: RGB picture of WIDTH x (WIDTH + PANEL) pixels
    :raises ValueError: if the frame is no RGB picture
    """
    if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
        raise ValueError(f"A frame is an array (height, width, 3) of uint8: got {frame.shape} of {frame.dtype}")
    picture = Image.new("RGB", (WIDTH, WIDTH + PANEL), BACKGROUND)
    grid = ImageOps.contain(Image.fromarray(frame), (WIDTH, WIDTH))
    picture.paste(grid, ((WIDTH - grid.size[0]) // 2, (WIDTH - grid.size[1]) // 2))
    draw_caption(ImageDraw.Draw(picture), caption)
    return picture


def draw_caption(draw: ImageDraw.ImageDraw, caption: Caption) -> None:
    """
    :param draw: on a picture of WIDTH x (WIDTH + PANEL) pixels
    :param caption: to be written below the grid
    """
    mission = textwrap.shorten(caption.mission, 3 * MISSION_COLUMNS - 12, placeholder=" ...")
    draw.multiline_text((14, WIDTH + 10), textwrap.fill(mission, MISSION_COLUMNS), TEXT, font("DejaVu Sans", 13), spacing=4)
    for x, label, value, colour in ((14, "message", caption.message, MESSAGE), (160, "action", caption.action, ACTION)):
        draw.text((x, WIDTH + 74), label, FAINT, font("DejaVu Sans", 12))
        draw.text((x, WIDTH + 92), value or "-", colour if value else FAINT, font("DejaVu Sans Mono", 20))


def font(family: str, size: int) -> ImageFont.FreeTypeFont:
    """:return: a font that Matplotlib ships, so that the picture is the same on every machine"""
    return ImageFont.truetype(font_manager.findfont(family), size)


def share_palette(pictures: list[Image.Image]) -> list[Image.Image]:
    """
    :param pictures: RGB, of one size
    :return: the same in one palette, so that consecutive frames of a GIF differ only where something moved
    """
    strip = Image.fromarray(np.concatenate([np.asarray(picture) for picture in pictures[:: max(1, len(pictures) // 8)]]))
    palette = strip.quantize(COLOURS)
    return [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
