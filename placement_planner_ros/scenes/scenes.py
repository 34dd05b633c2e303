"""The bundled scenes: a cabinet with little and with much clutter, a full table; one for
any robot.

World = the YuMi's body frame: x forward, y left, z up, metres. All sizes follow the paper's
experiments.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.primitives import (
    Colour,
    ConvexPrimitive,
    bowl,
    box,
    frustum,
    standing_box,
)

_WOOD: Colour = (0.80, 0.68, 0.50)
_SHELF: Colour = (0.72, 0.58, 0.40)
_GREEN: Colour = (0.30, 0.55, 0.42)
_OCHRE: Colour = (0.82, 0.62, 0.25)
_RED: Colour = (0.75, 0.30, 0.30)

_BOXES: dict[str, tuple[tuple[float, float, float], Colour]] = {
    "bar": ((0.202, 0.036, 0.033), (0.55, 0.33, 0.22)),
    "thick_bar": ((0.202, 0.036, 0.034), (0.55, 0.33, 0.22)),
    "tin": ((0.102, 0.057, 0.084), (0.55, 0.60, 0.68)),
    "box": ((0.217, 0.072, 0.167), _OCHRE),
    "flat_bottle": ((0.096, 0.059, 0.191), _GREEN),
    "small_box": ((0.094, 0.048, 0.176), _OCHRE),
}
"""Length, width and height in metres."""
_CANS: dict[str, tuple[float, float, Colour]] = {
    "bottle": (0.068, 0.227, _GREEN),
    "can": (0.068, 0.102, _RED),
    "low_can": (0.085, 0.034, _RED),
}
"""Diameter and height in metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A planning scene: what stands there and where the object shall go.

    Attributes:
        name: as on the command line.
        volume: the target volume V.
        parts: convex solids in the world frame whose union is the environment.
    """

    name: str
    volume: TargetVolume
    parts: tuple[ConvexPrimitive, ...]


def _cabinet_parts() -> tuple[ConvexPrimitive, ...]:
    # the outside, then what divides it
    left, right = -0.489, 0.412  # y range; open towards −x
    return (
        box("drawers", (0.366, left, -0.560), (0.810, right, 0.176), _WOOD),
        box("left_wall", (0.366, 0.392, 0.176), (0.810, right, 0.508), _WOOD),
        box("right_wall", (0.366, left, 0.176), (0.810, -0.469, 0.508), _WOOD),
        box("back", (0.794, left, 0.177), (0.814, right, 0.517), _WOOD),
        box("top", (0.442, left, 0.496), (0.810, right, 0.516), _WOOD),
        box("divider", (0.498, 0.124, 0.176), (0.792, 0.137, 0.496), _SHELF),
        box("lower_shelf", (0.498, 0.137, 0.250), (0.792, 0.392, 0.263), _SHELF),
        box("upper_shelf", (0.498, 0.137, 0.378), (0.792, 0.392, 0.391), _SHELF),
    )


_DECK, _LOWER_SHELF, _TABLE = 0.176, 0.263, 0.0
CABINET_VOLUME = TargetVolume([0.33, -0.53, 0.15], [0.75, 0.40, 0.44])
"""Target volume in both cabinets."""


def _thing(name: str, at: tuple[float, float, float], degrees: float = 0.0) -> ConvexPrimitive:
    """A box or can that stands there (3,), turned about the vertical."""
    if name in _BOXES:
        size, colour = _BOXES[name]
        return standing_box(name, size, at[:2], np.deg2rad(degrees), at[2], colour)
    diameter, height, colour = _CANS[name]
    radius = diameter / 2
    return frustum(name, (radius, radius), (at[2], at[2] + height), colour, at[:2])


def _bowl(x: float, y: float, z: float) -> tuple[ConvexPrimitive, ...]:
    return bowl("bowl", (0.160, 0.055), (x, y, z), (0.86, 0.86, 0.90))


def _cabinet_low_clutter() -> Scene:
    clutter = (
        _thing("bar", (0.588, -0.369, _DECK), 3),
        _thing("tin", (0.560, 0.223, _LOWER_SHELF), -1),
        _thing("bottle", (0.507, -0.177, _DECK)),
    )
    return Scene("cabinet_low_clutter", CABINET_VOLUME, _cabinet_parts() + clutter)


def _cabinet_high_clutter() -> Scene:
    clutter = (
        _thing("box", (0.630, -0.332, _DECK), -1),
        *_bowl(0.677, -0.078, _DECK),
        _thing("flat_bottle", (0.499, -0.162, _DECK), 170),
        _thing("can", (0.454, 0.269, _DECK)),
        _thing("low_can", (0.549, 0.197, _LOWER_SHELF)),
        _thing("bar", (0.488, 0.023, _DECK), 134),
    )
    return Scene("cabinet_high_clutter", CABINET_VOLUME, _cabinet_parts() + clutter)


def _table_scene() -> Scene:
    parts = (
        box("table", (0.139, -0.426, -0.500), (0.695, 0.474, 0.0), _WOOD),
        _thing("thick_bar", (0.321, -0.330, _TABLE), 2),
        _thing("tin", (0.467, 0.223, _TABLE), -1),
        _thing("bottle", (0.507, -0.167, _TABLE)),
        _thing("box", (0.300, -0.082, _TABLE), 142),
        *_bowl(0.475, 0.072, _TABLE),
        _thing("flat_bottle", (0.591, -0.305, _TABLE), 170),
        _thing("can", (0.440, 0.343, _TABLE)),
        _thing("low_can", (0.599, 0.272, _TABLE)),
        _thing("small_box", (0.267, 0.252, _TABLE), 102),
    )
    return Scene("table", TargetVolume([0.17, -0.40, -0.10], [0.66, 0.40, 0.10]), parts)


def _shelf() -> Scene:
    """A board with a back and two sides, open above and towards the robot: to lean things in."""
    left, right, back = 0.34, -0.34, 0.70
    parts = (
        box("board", (0.30, right, -0.30), (back, left, 0.10), _WOOD),
        box("back", (back, right, -0.30), (back + 0.02, left, 0.40), _SHELF),
        box("left_side", (0.40, left, -0.30), (back + 0.02, left + 0.02, 0.40), _SHELF),
        box("right_side", (0.40, right - 0.02, -0.30), (back + 0.02, right, 0.40), _SHELF),
        _thing("bottle", (0.60, -0.12, 0.10)),
        _thing("tin", (0.62, 0.25, 0.10), 20),
    )
    return Scene("shelf", TargetVolume([0.32, -0.33, 0.07], [0.70, 0.33, 0.35]), parts)


def table_of_things(volume: TargetVolume) -> Scene:
    """A table whose top is 3 cm above the bottom of V, with seven things on it."""
    lower, upper = volume.lower, volume.upper
    top = float(lower[2]) + 0.03
    things = []
    for name, along, across, degrees in (
        ("bottle", 0.12, 0.15, 0.0),
        ("flat_bottle", 0.85, 0.14, 25.0),
        ("can", 0.55, 0.30, 0.0),
        ("tin", 0.15, 0.85, -15.0),
        ("low_can", 0.88, 0.55, 0.0),
        ("bar", 0.50, 0.92, 5.0),
        ("small_box", 0.85, 0.86, 60.0),
    ):
        # places are shares of V's base
        x, y = (lower[:2] + (along, across) * (upper - lower)[:2]).tolist()
        things.append(_thing(name, (x, y, top), degrees))
    # it reaches 3 cm beyond V on every side
    table = box("table", (*(lower[:2] - 0.03), top - 0.04), (*(upper[:2] + 0.03), top), _WOOD)
    return Scene("table_of_things", volume, (table, *things))


_SCENES: dict[str, Callable[[], Scene]] = {
    "cabinet_low_clutter": _cabinet_low_clutter,
    "cabinet_high_clutter": _cabinet_high_clutter,
    "table": _table_scene,
    "shelf": _shelf,
}

BUNDLED_SCENES: tuple[str, ...] = tuple(_SCENES)
SCENE_NAMES: tuple[str, ...] = BUNDLED_SCENES[:3]
"""The paper's."""


@functools.cache
def scene_by_name(name: str) -> Scene:
    """Build a bundled scene.

    Raises:
        ParameterError: no such scene; the message lists those there are.
    """
    if name not in _SCENES:
        raise ParameterError("scene", name, f"choose one of {', '.join(BUNDLED_SCENES)}")
    return _SCENES[name]()
