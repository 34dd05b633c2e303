"""Several things put down one after the other: where all stand at last, and the whole, moving."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.transforms import Bbox

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.demo.physics.carrying_out import CARRY, DOWN, Look
from placement_planner_ros.pictures.animation import (
    TITLE,
    frames_and_speed,
    speed_words,
    titled_frame,
    write_animation,
)
from placement_planner_ros.pictures.picture import (
    HAND,
    OVERSAMPLING,
    RobotShapes,
    Triangles,
    averaged,
    box_corners,
    hiding,
    moved,
    translucent,
)
from placement_planner_ros.pictures.plots import DPI, new_figure
from placement_planner_ros.pictures.rendering import Image, Mesh, Viewpoint, joined, render
from placement_planner_ros.pictures.stage_set import tube, volume_edges, with_surroundings
from placement_planner_ros.pictures.viewpoint import best_direction, seen_share
from placement_planner_ros.scenes.primitives import Colour
from placement_planner_ros.scenes.scenes import Scene

COLOURS: tuple[Colour, ...] = (
    (0.15, 0.70, 0.25),
    (0.15, 0.45, 0.90),
    (0.65, 0.25, 0.80),
    (0.98, 0.78, 0.10),
)
"""Of the things, one after the other, and of the ways that they are carried."""
_WAY_RADIUS = 0.003
_MOST_FRAMES = 200
ANIMATION_SIZE = (720, 540 - TITLE)
"""Pixels of an animation without its words."""
_PICTURE_SIZE = (1320, 820)
"""Pixels of the picture without its words."""
_HEAD, _ROW, _FOOT = 0.45, 0.27, 0.15
"""Inches: of the title, a row of the table, and what is below that."""
_ROUND_WAY = 0.06
"""m around V and the ways that a picture holds of the robot and the scene."""
_WHOLE = 0.1
"""Of the score of a view, what it counts that the scene need not be seen through."""


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """One thing put down.

    Attributes:
        name: for people.
        key: by which looks name the thing.
        vertices, triangles: (n, 3) and (t, 3) in its frame.
        looks: at each moment, the last at what has come of it.
    """

    name: str
    key: str
    vertices: Array
    triangles: Triangles
    looks: Sequence[Look]

    @property
    def halfway(self) -> Look:
        """While it is carried."""
        held = [look for look in self.looks if look.stage in (CARRY, DOWN)]
        return held[2 * len(held) // 3]

    @property
    def way(self) -> Array:
        """(n, 3) where the thing's origin is carried along."""
        held = [look for look in self.looks if look.stage in (CARRY, DOWN)]
        return np.array([look.places[self.key].translation for look in held])


class TourStage:
    """The scene of a tour, ready to be drawn at any look.

    Args:
        hand_links: links in the darker colour.
        legs: in order.
        size: pixels of a picture once it is averaged, width and height.
    """

    def __init__(
        self,
        scene: Scene,
        robot: Robot,
        hand_links: Sequence[str],
        legs: Sequence[Leg],
        size: tuple[int, int] = ANIMATION_SIZE,
    ) -> None:
        self.legs = legs
        self._colours = {leg.key: COLOURS[k % len(COLOURS)] for k, leg in enumerate(legs)}
        self._robot = RobotShapes(robot, hand_links)
        self._parts = [Mesh(part.vertices, part.triangles, part.colour) for part in scene.parts]
        self._ways = [tube(leg.way, _WAY_RADIUS, self._colours[leg.key]) for leg in legs]
        self._edges = volume_edges(scene.volume)
        self._points = self._shown(scene)
        self._direction = best_direction(self._points, self._scored())
        self._show(size)

    def sized(self, size: tuple[int, int]) -> TourStage:
        """The same from the same side in another size."""
        other = copy(self)
        other._show(size)
        return other

    def _show(self, size: tuple[int, int]) -> None:
        width, height = (OVERSAMPLING * side for side in size)
        self.view = Viewpoint.around(self._points, *self._direction, width, height)
        parts = translucent(self._parts, self._hides(self.view))
        self._glass = [part for part in parts if part.alpha < 1.0]
        solid = [part for part in parts if part.alpha == 1.0]
        self._behind = render(self.view, joined([*solid, *self._edges]))
        self._link_hides = [self._hidden_by_links(leg.looks[-1]) for leg in self.legs]

    def draw(self, leg: int, look: Look, all_ways: bool = False) -> Image:
        """The picture of that moment of a leg, with its way, or with those of all legs."""
        links = translucent(self._robot.at(look.q), self._link_hides[leg])
        ways = self._ways if all_ways else [self._ways[leg]]
        shown = [*joined(links), *ways, *self._things(look), *self._glass]
        return render(self.view, shown, self._behind)

    def _things(self, look: Look) -> list[Mesh]:
        return [
            Mesh(moved(leg.vertices, look.places[leg.key]), leg.triangles, self._colours[leg.key])
            for leg in self.legs
            if leg.key in look.places
        ]

    def _hidden_by_links(self, look: Look) -> list[bool]:
        """Which links stand before a thing at last."""
        links = self._robot.at(look.q)
        hides = [hiding(self.view, thing.vertices, links) for thing in self._things(look)]
        return np.any(hides, axis=0).tolist()

    def _hands(self, look: Look) -> list[Array]:
        """(n, 3) each."""
        return [link.vertices for link in self._robot.at(look.q) if link.colour == HAND]

    def _shown(self, scene: Scene) -> Array:
        """(n, 3) points that the picture has to hold."""
        must = [box_corners(scene.volume.lower, scene.volume.upper)]
        must += [leg.way for leg in self.legs]
        must += [moved(leg.vertices, leg.looks[0].places[leg.key]) for leg in self.legs]
        must += self._hands(self.legs[0].looks[0])
        robot = [link for leg in self.legs for link in self._robot.at(leg.looks[-1].q)]
        return with_surroundings(np.vstack(must), [*robot, *self._parts], _ROUND_WAY)

    def _scored(self) -> Callable[[Viewpoint], float]:
        """How much the robot leaves to be seen of things, halfway and where they stand, and of
        their ways; and, counting less, how much the scene does."""
        last = self._things(self.legs[-1].looks[-1])
        parts, compared = joined(self._parts), []
        for leg, stands, way in zip(self.legs, last, self._ways, strict=True):
            links = [joined(self._robot.at(look.q)) for look in (leg.halfway, leg.looks[-1])]
            held = self._things(leg.halfway)[-1]
            others = [other for other in last if other is not stands]
            compared.append((links, held, [*links[1], *others], stands, way))

        def score(view: Viewpoint) -> float:
            behind = render(view, parts)
            seen = []
            for links, held, others, stands, way in compared:
                seen.append(seen_share(view, None, links[0], held))
                seen.append(seen_share(view, None, others, stands))
                seen.append(0.5 * seen_share(view, None, links[0], way))
                seen.append(_WHOLE * seen_share(view, behind, [], stands))
            return float(np.sum(seen)) / len(compared)

        return score

    def _hides(self, view: Viewpoint) -> list[bool]:
        """Which parts of the scene stand before a thing at its place or on its way."""
        hides = np.zeros(len(self._parts), dtype=bool)
        for thing, leg in zip(self._things(self.legs[-1].looks[-1]), self.legs, strict=True):
            hides |= hiding(view, thing.vertices, self._parts)
            hides |= hiding(view, leg.way, self._parts)
        return hides.tolist()


def draw_tour(
    path: Path, stage: TourStage, title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]
) -> None:
    """Write a PNG: all things where they stand at last, their ways, and a table.

    Args:
        columns: heads of the table, the first for the things' names.
        rows: one for each leg.
    """
    width, tall = (side / DPI for side in _PICTURE_SIZE)
    height = _HEAD + tall + _ROW * (len(rows) + 1) + _FOOT
    figure = new_figure(width, height, constrained=False)
    figure.text(0.5, 1.0 - 0.12 / height, title, fontsize=13, ha="center", va="top")
    below = (height - _HEAD - tall) / height
    axes = figure.add_axes((0.0, below, 1.0, tall / height))
    last, stage = len(stage.legs) - 1, stage.sized(_PICTURE_SIZE)
    axes.imshow(
        averaged(stage.draw(last, stage.legs[last].looks[-1], all_ways=True).colours), aspect="auto"
    )
    axes.set_axis_off()
    table = figure.add_axes((0.03, _FOOT / height, 0.94, below - _FOOT / height))
    table.set_axis_off()
    colours = [COLOURS[number % len(COLOURS)] for number in range(len(rows))]
    cells = table.table(
        rows, colLabels=columns, rowLabels=[" "] * len(rows), rowColours=colours, bbox=Bbox.unit()
    )
    cells.auto_set_font_size(False)
    cells.set_fontsize(11)
    figure.savefig(path)


def draw_tour_animation(
    path: Path, stage: TourStage, told: Callable[[int, int], None] = lambda done, count: None
) -> None:
    """Write a GIF of the whole.

    Args:
        told: of how many frames are done, and of how many there are.
    """
    duration = sum(leg.looks[-1].time for leg in stage.legs)
    count, speed = frames_and_speed(duration, _MOST_FRAMES)
    moments = [
        (number, look)
        for number, leg in enumerate(stage.legs)
        for look in _spread(leg.looks, duration / (count - 1))
    ]
    moments.append((len(stage.legs) - 1, stage.legs[-1].looks[-1]))
    frames = []
    for number, look in moments:
        name = f"{number + 1} of {len(stage.legs)}, {stage.legs[number].name}"
        line = f"{name}: {look.stage}, {speed_words(speed)}"
        frames.append(titled_frame(stage.draw(number, look), line, above=True))
        told(len(frames), len(moments))
    write_animation(path, frames, COLOURS[: len(stage.legs)])


def _spread(looks: Sequence[Look], step: float) -> list[Look]:
    """Those nearest to moments so many seconds apart."""
    times = np.array([look.time for look in looks])
    return [looks[int(np.abs(times - time).argmin())] for time in np.arange(0.0, times[-1], step)]
