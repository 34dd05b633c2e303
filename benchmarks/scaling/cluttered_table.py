"""The table with as many things on it as wanted, for seeing how planning time grows with them."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.scenes.primitives import (
    Colour,
    ConvexPrimitive,
    box,
    frustum,
    standing_box,
)
from placement_planner_ros.scenes.scenes import Scene, scene_by_name

MOST_THINGS = 16
"""There is room for these; more might not find any."""
_GAP = 0.01
_BOXES = (("tin", (0.102, 0.057, 0.084)), ("small_box", (0.094, 0.048, 0.176)))
_ROUND = (("bottle", 0.068, 0.227), ("can", 0.068, 0.102), ("low_can", 0.085, 0.034))
_WOOD: Colour = (0.80, 0.68, 0.50)
_THING: Colour = (0.55, 0.60, 0.68)


def cluttered_table(things: int) -> Scene:
    """The bundled table, cleared, with boxes and round things at random places of its volume.

    The places are always the same, and those of few things are among those of many.

    Args:
        things: how many, 0 to `MOST_THINGS`.

    Raises:
        ParameterError: more than there is room for.
    """
    if not 0 <= things <= MOST_THINGS:
        raise ParameterError("things", things, f"give 0 to {MOST_THINGS}")
    volume = scene_by_name("table").volume
    rng = np.random.default_rng(0)
    parts = [box("table", (0.139, -0.426, -0.500), (0.695, 0.474, 0.0), _WOOD)]
    discs: list[tuple[float, float, float]] = []
    while len(discs) < things:
        kind = len(discs) % (len(_BOXES) + len(_ROUND))
        radius = _radius(kind)
        x, y = rng.uniform(volume.lower[:2] + radius, volume.upper[:2] - radius).tolist()
        yaw = rng.uniform(0.0, np.pi)
        if all(np.hypot(x - a, y - b) > radius + r + _GAP for a, b, r in discs):
            discs.append((x, y, radius))
            parts.append(_thing(kind, f"{len(discs)}", (x, y), yaw))
    return Scene(f"table_with_{things}_things", volume, tuple(parts))


def _radius(kind: int) -> float:
    """Of the circle around the footprint, metres."""
    if kind < len(_BOXES):
        size = _BOXES[kind][1]
        return float(np.hypot(size[0], size[1])) / 2
    return _ROUND[kind - len(_BOXES)][1] / 2


def _thing(kind: int, number: str, centre: tuple[float, float], yaw: float) -> ConvexPrimitive:
    if kind < len(_BOXES):
        name, size = _BOXES[kind]
        return standing_box(f"{name}_{number}", size, centre, yaw, 0.0, _THING)
    name, diameter, height = _ROUND[kind - len(_BOXES)]
    radius = diameter / 2
    return frustum(f"{name}_{number}", radius, radius, 0.0, height, _THING, centre)
