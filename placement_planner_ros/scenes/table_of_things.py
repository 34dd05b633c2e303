"""A table of seven things in front of any robot: wherever its target volume is."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.primitives import (
    Colour,
    ConvexPrimitive,
    box,
    frustum,
    standing_box,
)
from placement_planner_ros.scenes.scenes import Scene

ABOVE = 0.03
"""m from the bottom of V to the table's top."""
_RIM = 0.03
_THICK = 0.04
_WOOD: Colour = (0.80, 0.68, 0.50)
_BOX: Colour = (0.82, 0.62, 0.25)
_ROUND: Colour = (0.30, 0.55, 0.42)
_LOW: Colour = (0.75, 0.30, 0.30)

_THINGS: tuple[tuple[str, float, float, float], ...] = (
    ("bottle", 0.12, 0.15, 0.0),
    ("box", 0.85, 0.14, 25.0),
    ("can", 0.55, 0.30, 0.0),
    ("tin", 0.15, 0.85, -15.0),
    ("low_can", 0.88, 0.55, 0.0),
    ("bar", 0.50, 0.92, 5.0),
    ("small_box", 0.85, 0.86, 60.0),
)
"""Name, place in V's base as shares of its sides, and degrees about the vertical."""


def table_of_things(volume: TargetVolume) -> Scene:
    """A table whose top is a little above the bottom of V, with seven things on it."""
    lower, upper = volume.lower, volume.upper
    top = float(lower[2]) + ABOVE
    corners = (
        (float(lower[0]) - _RIM, float(lower[1]) - _RIM, top - _THICK),
        (float(upper[0]) + _RIM, float(upper[1]) + _RIM, top),
    )
    things = []
    for name, along, across, degrees in _THINGS:
        at = lower[:2] + np.array([along, across]) * (upper - lower)[:2]
        things.append(_standing_thing(name, (float(at[0]), float(at[1])), np.deg2rad(degrees), top))
    return Scene("table_of_things", volume, (box("table", *corners, _WOOD), *things))


def _standing_thing(name: str, at: tuple[float, float], yaw: float, z: float) -> ConvexPrimitive:
    if name in _BOXES:
        return standing_box(name, _BOXES[name], at, yaw, z, _BOX)
    radius, height = _CANS[name]
    return frustum(name, radius, radius, z, z + height, _LOW if height < 0.05 else _ROUND, at)


_BOXES = {
    "box": (0.12, 0.07, 0.16),
    "tin": (0.102, 0.057, 0.084),
    "bar": (0.202, 0.036, 0.033),
    "small_box": (0.094, 0.048, 0.12),
}
_CANS = {"bottle": (0.034, 0.20), "can": (0.034, 0.102), "low_can": (0.043, 0.034)}
