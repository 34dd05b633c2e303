"""A motion as pictures: before and after side by side, and moving."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.patches import Patch
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from placement_planner_ros.pictures.picture import VOLUME, averaged
from placement_planner_ros.pictures.plots import DPI, new_figure
from placement_planner_ros.pictures.rendering import Image
from placement_planner_ros.pictures.stage_set import COLOURS, SIZE, Look, StageSet
from placement_planner_ros.scenes.primitives import Colour

_FRAME = 0.08
"""Seconds from frame to frame; GIF counts in hundredths."""
_MOST_FRAMES = 90
"""Of one thing put down; longer motions are shown faster."""
_REST_BEFORE, _REST_AFTER = 0.6, 1.5
"""Seconds for which the first and the last frame stay."""
_COLOURS = 128
_SHADES = (0.5, 0.75, 1.0)
_STRIP = 30
"""Of each colour that a palette must have, and the pixels of it that are added for that."""
TITLE = 26
"""Pixels that a line of words is high."""
_HALF = (SIZE[0] / DPI, SIZE[1] / DPI)
_HEAD, _FOOT = 0.75, 0.5
"""Inches: of half the picture, the lines above it and the legend below."""


def draw_before_and_after(path: Path, shown: StageSet, title: str) -> None:
    """Write a PNG: the start on the left, the end on the right, and the way of the object."""
    looks = shown.legs[0].looks
    width, height = 2 * _HALF[0], _HEAD + _HALF[1] + _FOOT
    figure = new_figure(width, height, constrained=False)
    figure.text(0.5, 1.0 - 0.14 / height, title, fontsize=13, ha="center", va="top")
    for side, (name, look) in enumerate((("before", looks[0]), ("after", looks[-1]))):
        place = (side / 2 + 0.002, _FOOT / height, 0.496, _HALF[1] / height)
        axes = figure.add_axes(place)
        axes.imshow(averaged(shown.draw(0, look).colours), aspect="auto")
        axes.set_axis_off()
        axes.set_title(name, fontsize=12, pad=4)
    entries = [
        Patch(color=COLOURS[0], label="object, and the way of its origin"),
        Patch(color=VOLUME, label="target volume"),
    ]
    figure.legend(handles=entries, loc="lower center", ncols=2, fontsize=11, frameon=False)
    figure.savefig(path)


def draw_animation(
    path: Path, stage: StageSet, told: Callable[[int, int], None] = lambda done, count: None
) -> None:
    """Write a GIF of the whole, releases and retreats included.

    Args:
        told: of how many frames are done, and of how many there are.
    """
    legs = stage.legs
    duration = sum(leg.looks[-1].time for leg in legs)
    count, speed = frames_and_speed(duration, min(len(legs) * _MOST_FRAMES, 200))
    moments = [
        (number, look)
        for number, leg in enumerate(legs)
        for look in _spread_looks(leg.looks, duration / (count - 1))
    ]
    moments.append((len(legs) - 1, legs[-1].looks[-1]))
    frames = []
    for number, look in moments:
        of_several = f"{number + 1} of {len(legs)}, " if len(legs) > 1 else ""
        line = f"{of_several}{legs[number].name}: {look.stage}, {speed_words(speed)}"
        frames.append(titled_frame(stage.draw(number, look), line))
        told(len(frames), len(moments))
    write_animation(path, frames, COLOURS[: len(legs)])


def _spread_looks(looks: Sequence[Look], step: float) -> list[Look]:
    """Those nearest to moments so many seconds apart."""
    times = np.array([look.time for look in looks])
    return [looks[int(np.abs(times - time).argmin())] for time in np.arange(0.0, times[-1], step)]


def frames_and_speed(duration: float, most: int) -> tuple[int, float]:
    """How many frames show a motion of that many seconds, and how many times as fast as it is."""
    count = min(most, 1 + int(np.ceil(duration / _FRAME)))
    return count, max(1.0, duration / (_FRAME * (count - 1)))


def speed_words(speed: float) -> str:
    """How fast an animation goes."""
    return "in real time" if speed < 1.05 else f"{speed:.1f} times as fast as it is"


def titled_frame(image: Image, line: str) -> Picture.Image:
    """A frame, once its pixels are averaged, with a line of words above it."""
    shown = Picture.fromarray((averaged(image.colours) * 255.0).round().astype(np.uint8))
    frame = Picture.new("RGB", (shown.width, shown.height + TITLE), "white")
    frame.paste(shown, (0, TITLE))
    ImageDraw.Draw(frame).text((8, 4), line, fill="black", font=_title_font())
    return frame


@cache
def _title_font() -> ImageFont.FreeTypeFont:
    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    return ImageFont.truetype(str(folder / "DejaVuSans.ttf"), 15)


def write_animation(path: Path, frames: list[Picture.Image], needed: Sequence[Colour]) -> None:
    """As a GIF with one palette for all frames, so that what rests does not flicker.

    Args:
        needed: colours that it must have, of things that may be small.
    """
    samples = frames[:: max(1, len(frames) // 4)]
    width, height = frames[0].size
    strips = [(colour, shade) for colour in needed for shade in _SHADES]
    together = Picture.new("RGB", (width, height * len(samples) + _STRIP * len(strips)))
    for row, frame in enumerate(samples):
        together.paste(frame, (0, row * height))
    for row, (colour, shade) in enumerate(strips):
        red, green, blue = (round(255.0 * shade * part) for part in colour)
        top = height * len(samples) + _STRIP * row
        together.paste((red, green, blue), (0, top, width, top + _STRIP))
    palette = together.quantize(_COLOURS)
    plain = [frame.quantize(palette=palette, dither=Picture.Dither.NONE) for frame in frames]
    durations = [round(1000 * _FRAME)] * len(plain)
    durations[0], durations[-1] = round(1000 * _REST_BEFORE), round(1000 * _REST_AFTER)
    plain[0].save(
        path, save_all=True, append_images=plain[1:], duration=durations, loop=0, optimize=True
    )
