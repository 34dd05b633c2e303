"""The bundled objects, and how the YuMi's hands hold them.

The paper's four are made of convex solids. The two of them that are not convex are there a second
time, as a single closed surface each.

The household's are what the paper has not: hollow, bent, put together of overlapping parts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.types import Array, frozen_array
from placement_planner_ros.scenes import household
from placement_planner_ros.scenes.grasped_object import (
    PALM,
    STEM,
    GraspedObject,
    assemble,
    grasp,
    surfaces_of,
    tilted,
)
from placement_planner_ros.scenes.primitives import Colour, box, frustum
from placement_planner_ros.scenes.single_mesh import joined_boxes, turned

_GREEN: Colour = (0.35, 0.75, 0.35)
_GLASS = (  # height, radius
    (0.000, 0.0285),
    (0.003, 0.0285),
    (0.012, 0.0040),
    (0.075, 0.0040),
    (0.120, 0.0420),
    (0.145, 0.0285),
)
"""Outline of the wine glass, metres."""
_GLASS_SIDES = 32


def _large_crayons_box() -> GraspedObject:
    """144 × 124 × 36 mm, held across its thickness: over either edge or over a corner."""
    x, y, z = 0.072, 0.062, 0.018
    grasps = (
        grasp((0, 0, 1), (1, 0, 0), (-x, 0, 0), PALM),
        grasp((0, 0, 1), (0, 1, 0), (0, -y, 0), PALM),
        grasp((0, 0, 1), (1, 1, 0), (-x, -y, 0), PALM),
    )
    parts = (box("large_crayons_box", (-x, -y, -z), (x, y, z), _GREEN),)
    return assemble("large_crayons_box", surfaces_of(parts), parts, grasps, z, (0, 0, 0))


def _small_crayons_box() -> GraspedObject:
    """94 × 21 × 71 mm, held across its thickness: over either edge or over a corner."""
    x, y, z = 0.047, 0.0105, 0.0355
    grasps = (
        grasp((0, 1, 0), (1, 0, 0), (-x, 0, 0), PALM),
        grasp((0, 1, 0), (0, 0, -1), (0, 0, z), PALM),
        grasp((0, 1, 0), (1, 0, -1), (-x, 0, z), PALM),
    )
    parts = (box("small_crayons_box", (-x, -y, -z), (x, y, z), _GREEN),)
    return assemble("small_crayons_box", surfaces_of(parts), parts, grasps, y, (0, 0, 0))


def _wine_glass() -> GraspedObject:
    """145 mm high, foot on the plane z = 0, held by its stem from the side.

    Being round, it can be turned about its axis by the placement; the grasps differ in height
    and in how far the hand points down (or, for standing on the rim, up).
    """
    parts = tuple(
        frustum(f"wine_glass/{name}", r0, r1, z0, z1, _GREEN, sides=_GLASS_SIDES)
        for name, (z0, r0), (z1, r1) in zip(
            ("foot", "foot_top", "stem", "bowl_bottom", "bowl_top"),
            _GLASS,
            _GLASS[1:],
            strict=False,
        )
    )
    grasps = (
        grasp((0, 1, 0), tilted(0), (0, 0, 0.052), STEM),
        grasp((0, 1, 0), tilted(30), (0, 0, 0.034), STEM),
        grasp((0, 1, 0), tilted(-30), (0, 0, 0.060), STEM),
    )
    return assemble("wine_glass", surfaces_of(parts), parts, grasps, 0.004, (0, 0, 0.050))


def _toy_table() -> GraspedObject:
    """Plate 110 × 70 × 6 mm on four legs 6 mm thick, 73 mm high, feet on the plane z = 0.

    Held by its plate from a long or a short side (to stand on its feet or a side), or by a leg
    from below (to stand on its plate or a side).
    """
    top, plate, leg = 0.073, 0.006, 0.006
    parts = [box("toy_table/plate", (-0.055, -0.035, top - plate), (0.055, 0.035, top), _GREEN)]
    for i, (sx, sy) in enumerate(((-1, -1), (-1, 1), (1, -1), (1, 1))):
        x, y = sx * (0.051 - leg / 2), sy * (0.030 - leg / 2)
        low, high = (x - leg / 2, y - leg / 2, 0.0), (x + leg / 2, y + leg / 2, top - plate)
        parts.append(box(f"toy_table/leg_{i}", low, high, _GREEN))
    middle = top - plate / 2
    grasps = (
        grasp((0, 0, 1), (0, 1, 0), (0, -0.035, middle), PALM),
        grasp((0, 0, 1), (1, 0, 0), (-0.055, 0, middle), PALM),
        grasp((1, 0, 0), (0, 0, 1), (0.048, 0.027, 0), PALM),
    )
    return assemble("toy_table", surfaces_of(parts), parts, grasps, plate / 2, (0, 0, 0.044))


def _wine_glass_mesh() -> GraspedObject:
    """The wine glass as one surface."""
    glass = _wine_glass()
    return _in_one(glass, "wine_glass_mesh", *turned(_GLASS, _GLASS_SIDES))


def _toy_table_mesh() -> GraspedObject:
    """The toy table as one surface."""
    table = _toy_table()
    boxes = [(part.vertices.min(axis=0), part.vertices.max(axis=0)) for part in table.parts]
    return _in_one(table, "toy_table_mesh", *joined_boxes(boxes))


def _in_one(
    thing: GraspedObject, name: str, vertices: Array, triangles: npt.NDArray[np.int64]
) -> GraspedObject:
    """The same thing with the surface of its union for its mesh."""
    triangles.setflags(write=False)
    return replace(thing, name=name, vertices=frozen_array(vertices), triangles=triangles)


_OBJECTS: dict[str, Callable[[], GraspedObject]] = {
    "large_crayons_box": _large_crayons_box,
    "small_crayons_box": _small_crayons_box,
    "wine_glass": _wine_glass,
    "toy_table": _toy_table,
}
_IN_ONE: dict[str, Callable[[], GraspedObject]] = {
    "wine_glass_mesh": _wine_glass_mesh,
    "toy_table_mesh": _toy_table_mesh,
}
_HOUSEHOLD: dict[str, Callable[[], GraspedObject]] = {
    "mug": household.mug,
    "bowl": household.bowl,
    "tray": household.tray,
    "bin": household.bin_,
    "drill": household.drill,
    "banana": household.banana,
}

OBJECT_NAMES: tuple[str, ...] = tuple(_OBJECTS)
"""The paper's."""

SINGLE_MESHES: tuple[str, ...] = tuple(_IN_ONE)
"""Those of them that are not convex, as one surface."""

HOUSEHOLD: tuple[str, ...] = tuple(_HOUSEHOLD)
"""Things that the paper does not have: hollow, bent, put together of overlapping parts."""

ALL_OBJECTS: tuple[str, ...] = OBJECT_NAMES + SINGLE_MESHES + HOUSEHOLD


def object_by_name(name: str) -> GraspedObject:
    """Build a bundled object.

    Raises:
        ParameterError: no such object; the message lists those there are.
    """
    known = _OBJECTS | _IN_ONE | _HOUSEHOLD
    if name not in known:
        raise ParameterError("object", name, f"choose one of {', '.join(known)}")
    return known[name]()
