"""Files that a tour leaves: a table, a picture and an animation of the whole."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from placement_planner_ros.demo.results import unwritten
from placement_planner_ros.demo.tour import Stop, Tour
from placement_planner_ros.pictures.animation import draw_animation
from placement_planner_ros.pictures.picture import averaged
from placement_planner_ros.pictures.plots import DPI, new_figure
from placement_planner_ros.pictures.stage_set import Leg, StageSet
from placement_planner_ros.progress import ProgressLine
from placement_planner_ros.share import PACKAGE

COLUMNS = (
    "object", "by", "first [s]", "planned [s]", "reached", "off [mm]", "moved [mm]", "tilted [°]"
)  # fmt: skip
_PICTURE_SIZE = (1320, 820)
"""Pixels of the picture without its title."""
WORDS = (
    "first: seconds from the start of the search to the first placement; planned: to the one that "
    "was carried out. off: from its planned place as the arm arrived. moved, tilted: from there "
    "as it stands at last, with the hand gone."
)


def table_rows(stops: Sequence[Stop]) -> list[tuple[str, ...]]:
    """The table's cells, a row for each thing."""
    return [
        (
            stop.name,
            f"{stop.solution.arm} hand",
            f"{stop.found.improvements[0].search_time:.2f}",
            f"{stop.solution.search_time:.2f}",
            _reached_words(stop),
            f"{1000.0 * stop.outcome.off:.2f}",
            f"{1000.0 * stop.outcome.moved:.2f}",
            f"{np.rad2deg(stop.outcome.tilted):.2f}",
        )
        for stop in stops
    ]


def _reached_words(stop: Stop) -> str:
    if stop.outcome.reached:
        return "yes"
    struck = ", ".join(f"{one} on {other}" for one, other in stop.outcome.struck)
    return f"no: {struck}" if struck else "no"


def tour_table(tour: Tour) -> str:
    """The table in Markdown, and what it was taken with."""
    lines = [COLUMNS, ("---",) * len(COLUMNS), *table_rows(tour.stops)]
    table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    made = f"{PACKAGE} {version(PACKAGE)}, with mujoco {version('mujoco')}"
    asked = (
        f"scene {tour.setting.scene.name}, {tour.seconds:g} s of search after the first placement"
    )
    moved = f"What stood already was moved by at most {1000.0 * tour.knocked:.2f} mm"
    return f"{made}: {asked} of each.\n\n{table}\n\n{moved} while the others were put down.\n"


def write_tour(folder: Path, tour: Tour, line: ProgressLine) -> list[tuple[Path, str]]:
    """Draw it; each file with what it shows.

    Raises:
        DemoError: a file cannot be written.
    """
    setting = tour.setting
    picture, animation, table = (folder / name for name in ("tour.png", "tour.gif", "tour.md"))
    try:
        words = tour_table(tour)
        table.write_text(words, encoding="utf-8")
        line.show("  looking for the best view", always=True)
        hands = [link for name in ("left", "right") for link in setting.arm(name).touch_links]
        legs = [
            Leg(stop.name, stop.thing.name, stop.thing.vertices, stop.thing.triangles, stop.looks)
            for stop in tour.stops
        ]
        stage = StageSet(setting.scene, setting.robot, hands, legs)
        line.show("  drawing the picture", always=True)
        title = (
            f"{setting.scene.name.replace('_', ' ')}: four things put down, carried out by physics"
        )
        _draw_tour(picture, stage, title)

        def told(done: int, count: int) -> None:
            line.show(f"  drawing the animation: {done} of {count} frames")

        draw_animation(animation, stage, told)
    except OSError as error:
        raise unwritten(folder, error) from error
    line.clear()
    print(words)
    print(f"  {WORDS}")
    return [
        (picture, "where all stand at last, and how each was carried"),
        (animation, "the whole tour"),
        (table, "the table"),
    ]


def _draw_tour(path: Path, stage: StageSet, title: str) -> None:
    """Write a PNG: all things where they stand at last, and the ways that they were carried."""
    width, height = _PICTURE_SIZE
    figure = new_figure(width / DPI, (height + 50) / DPI)
    axes = figure.subplots()
    last, stage = len(stage.legs) - 1, stage.sized(_PICTURE_SIZE)
    image = stage.draw(last, stage.legs[last].looks[-1], all_ways=True)
    axes.imshow(averaged(image.colours))
    axes.set_axis_off()
    axes.set_title(title, fontsize=13)
    figure.savefig(path)
