"""A motion as pictures: before and after side by side, and moving."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from placement_planner_ros.pictures.rendering import Image
from placement_planner_ros.pictures.stage import Stage

_FRAME_S = 0.08
"""From frame to frame; GIF counts in hundredths."""
_MOST_FRAMES = 200
"""Longer motions are shown faster."""
TITLE = 26
"""Pixels that a line of words is high."""


def draw_before_and_after(path: Path, stage: Stage, title: str) -> None:
    """Write a PNG: the start on the left, the end on the right, with the ways of the things."""
    last = len(stage.legs) - 1
    before = titled_frame(stage.draw(0, 0.0), f"{title}: before")
    after = titled_frame(stage.draw(last, stage.legs[last].motion.duration), "after")
    side_by_side([before, after], 2).save(path)


def draw_animation(
    path: Path, stage: Stage, told: Callable[[int, int], None] = lambda done, count: None
) -> None:
    """Write a GIF of the whole, releases and retreats included.

    Args:
        told: of how many frames are done, and of how many there are.
    """
    duration = sum(leg.motion.duration for leg in stage.legs)
    # frames are farther apart in time where there would be too many
    step = max(_FRAME_S, duration / _MOST_FRAMES)
    speed = "in real time" if step == _FRAME_S else f"{step / _FRAME_S:.1f} times as fast as it is"
    # each leg from its beginning to its end
    moments = [
        (number, time)
        for number, leg in enumerate(stage.legs)
        for time in (*np.arange(0.0, leg.motion.duration, step).tolist(), leg.motion.duration)
    ]
    frames = []
    for number, time in moments:
        leg = stage.legs[number]
        words = f"{leg.name}: {leg.motion.at(time).stage}, {speed}"
        frames.append(titled_frame(stage.draw(number, time), words))
        told(len(frames), len(moments))
    # one palette for all, so that what rests does not flicker
    some = side_by_side(frames[:: max(1, len(frames) // 4)], 1)
    palette = some.quantize(255, method=Picture.Quantize.MAXCOVERAGE)
    plain = [frame.quantize(palette=palette, dither=Picture.Dither.NONE) for frame in frames]
    # the first and the last frame stay a little longer, ms
    durations = [600, *[round(1000 * _FRAME_S)] * (len(plain) - 2), 1500]
    plain[0].save(path, save_all=True, append_images=plain[1:], duration=durations, loop=0)


def titled_frame(image: Image, line: str) -> Picture.Image:
    """A picture of half the pixels, which smooths edges, with a line of words above it."""
    shown = Picture.fromarray((image.colours * 255.0).round().astype(np.uint8)).reduce(2)
    frame = Picture.new("RGB", (shown.width, shown.height + TITLE), "white")
    frame.paste(shown, (0, TITLE))
    font = ImageFont.load_default(TITLE // 2 + 2)
    ImageDraw.Draw(frame).text((8, 4), line, fill="black", font=font)
    return frame


def side_by_side(frames: Sequence[Picture.Image], in_a_row: int) -> Picture.Image:
    """Pictures of one size as one, row by row."""
    width, height = frames[0].size
    rows = -(-len(frames) // in_a_row)
    whole = Picture.new("RGB", (min(in_a_row, len(frames)) * width, rows * height), "white")
    for k, frame in enumerate(frames):
        whole.paste(frame, (k % in_a_row * width, k // in_a_row * height))
    return whole
