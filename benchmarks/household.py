"""Objects that the paper does not have: things of a household, and the paper's as one surface.

Those of a household are hollow, bent, or put together of overlapping parts. Each is one closed
surface, but for the mug, whose handle reaches into its wall, and the drill, whose parts reach into
each other. `parts` are convex solids made apart from the planner's covers: sectors of walls,
lengths of tubes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin

from benchmarks.single_mesh import Triangles, joined_boxes, tube, turned
from placement_planner_ros.core.types import Array, frozen_array
from placement_planner_ros.scenes import objects
from placement_planner_ros.scenes.objects import (
    GLASS_OUTLINE,
    OBJECT_NAMES,
    STEM,
    GraspedObject,
    grasp,
    tilted,
)
from placement_planner_ros.scenes.primitives import Colour, ConvexPrimitive, box, circle, frustum

_BLUE: Colour = (0.35, 0.50, 0.80)
_SIDES = 32
_RIM = 0.116
"""Depth in the tip frame of a rim between the fingers: 20 mm of the pads hold the wall."""
_DOWN = (0.0, 0.0, -1.0)

Level = tuple[float, float, float, float]
"""Of a wall: outer height and radius, inner height and radius, metres."""


def mug() -> GraspedObject:
    """80 mm wide, 95 mm high, held by its handle from the side."""
    wall: list[Level] = [(0.006, 0.040, 0.006, 0.036), (0.095, 0.040, 0.095, 0.036)]
    cup = _round_vessel("mug", 0.036, wall)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 13)
    path = np.column_stack(
        [0.038 + 0.032 * np.cos(angle), np.zeros(13), 0.048 + 0.030 * np.sin(angle)]
    )
    vertices, triangles = tube(path, np.full(13, 0.005), 12)
    parts = [*cup[2], *_tube_lengths("mug/handle", vertices, 12)]
    grasps = [
        grasp((0, 1, 0), (-np.cos(slope), 0, np.sin(slope)), (0.070, 0, 0.048), STEM)
        for slope in np.deg2rad((0, -30, 30))
    ]
    return assemble("mug", [cup[:2], (vertices, triangles)], parts, grasps, 0.005)


def bowl() -> GraspedObject:
    """120 mm wide, 60 mm high, held by its wall from above."""
    wall: list[Level] = [
        (0.006, 0.036, 0.006, 0.032),
        (0.032, 0.057, 0.034, 0.053),
        (0.060, 0.060, 0.060, 0.056),
    ]
    made = _round_vessel("bowl", 0.032, wall)
    grasps = [
        grasp((1, 0, 0), (0, np.sin(slope), -np.cos(slope)), (0.0558, 0, 0.060), _RIM)
        for slope in np.deg2rad((0, 15, -15))
    ]
    return assemble("bowl", [made[:2]], made[2], grasps, 0.0042)


def tray() -> GraspedObject:
    """150 × 110 × 30 mm, held by a wall from above."""
    return _of_boxes("tray", (0.075, 0.055, 0.030))


def bin_() -> GraspedObject:
    """100 × 80 × 110 mm, held by a wall from above."""
    return _of_boxes("bin", (0.050, 0.040, 0.110))


def drill() -> GraspedObject:
    """A motor with a chuck on a handle on a battery, 150 mm high, held by the handle."""
    parts = [
        _lying_cylinder("drill/motor", 0.022, -0.045, 0.045, 0.128),
        _lying_cylinder("drill/chuck", 0.012, 0.040, 0.080, 0.128),
        box("drill/handle", (-0.040, -0.014, 0.020), (-0.012, 0.014, 0.115), _BLUE),
        box("drill/battery", (-0.050, -0.028, 0.000), (0.015, 0.028, 0.030), _BLUE),
    ]
    grasps = [
        grasp((0, 1, 0), tilted(degrees), (-0.040, 0, height), 0.110)
        for degrees, height in ((0, 0.070), (20, 0.074), (-20, 0.066))
    ]
    return assemble(
        "drill", [(part.vertices, part.triangles) for part in parts], parts, grasps, 0.014
    )


def banana() -> GraspedObject:
    """170 mm long, bent, thinner at both ends, held across its middle."""
    angle = np.linspace(-0.75, 0.75, 25)
    path = np.column_stack([0.12 * np.sin(angle), np.zeros(25), 0.12 * (1.0 - np.cos(angle))])
    radii = 0.019 * np.sqrt(np.maximum(1.0 - (angle / 0.78) ** 4, 0.05))
    vertices, triangles = tube(path, radii, 16)
    grasps = [
        grasp((0, 0, 1), (np.sin(slope), side * np.cos(slope), 0), (0, 0, 0.0003), 0.130)
        for side in (-1, 1)
        for slope in np.deg2rad((0, 30))
    ]
    parts = _tube_lengths("banana", vertices, 16)
    return assemble("banana", [(vertices, triangles)], parts, grasps, 0.0194)


def _of_boxes(name: str, size: Sequence[float], wall: float = 0.004) -> GraspedObject:
    """A floor and four walls; held by the walls at -x and at -y.

    Args:
        size: half of the length and of the width, and the height, metres.
    """
    x, y, z = size
    boxes = [
        ((-x, -y, 0.0), (x, y, wall)),
        ((-x, -y, 0.0), (-x + wall, y, z)),
        ((x - wall, -y, 0.0), (x, y, z)),
        ((-x, -y, 0.0), (x, -y + wall, z)),
        ((-x, y - wall, 0.0), (x, y, z)),
    ]
    parts = [box(f"{name}/{k}", low, high, _BLUE) for k, (low, high) in enumerate(boxes)]
    surface = joined_boxes([(np.array(low), np.array(high)) for low, high in boxes])
    middle = wall / 2
    grasps = [
        grasp((1, 0, 0), (0, np.sin(a), -np.cos(a)), (-x + middle, 0, z), _RIM)
        for a in np.deg2rad((0, 30, -30))
    ]
    grasps.append(grasp((0, 1, 0), _DOWN, (0, -y + middle, z), _RIM))
    return assemble(name, [surface], parts, grasps, middle)


def _round_vessel(
    name: str, foot: float, wall: Sequence[Level]
) -> tuple[Array, Triangles, list[ConvexPrimitive]]:
    """A round floor of radius `foot` below, and a wall about z from the floor's top to its rim."""
    outer, inner = [level[:2] for level in wall], [level[2:] for level in wall]
    rings = [(0.0, foot), *outer, *inner[::-1]]
    parts = [frustum(f"{name}/floor", (foot, wall[0][1]), (0.0, wall[0][0]), _BLUE, sides=_SIDES)]
    for k, (below, above) in enumerate(pairwise(wall)):
        corners = [
            circle(level[i + 1], level[i], _SIDES) for level in (below, above) for i in (0, 2)
        ]
        for i in range(_SIDES):
            points = np.vstack([ring[[i, (i + 1) % _SIDES]] for ring in corners])
            parts.append(ConvexPrimitive(f"{name}/wall_{k}_{i}", points, _BLUE))
    return *turned(rings, _SIDES), parts


def _tube_lengths(name: str, vertices: Array, sides: int) -> list[ConvexPrimitive]:
    """Of a tube: the hulls of rings that follow each other."""
    rings = vertices[:-2].reshape(-1, sides, 3)
    return [
        ConvexPrimitive(f"{name}/{k}", np.vstack([a, b]), _BLUE)
        for k, (a, b) in enumerate(pairwise(rings))
    ]


def _lying_cylinder(
    name: str, radius: float, begin: float, end: float, height: float
) -> ConvexPrimitive:
    """A cylinder along x."""
    solid = frustum(name, (radius, radius), (begin, end), _BLUE, sides=_SIDES)
    points = solid.vertices[:, [2, 1, 0]] * [1.0, 1.0, -1.0] + [0.0, 0.0, height]
    return ConvexPrimitive(name, points, _BLUE)


def assemble(
    name: str,
    surfaces: Sequence[tuple[Array, Triangles]],
    parts: Sequence[ConvexPrimitive],
    grasps: Sequence[pin.SE3],
    finger_opening: float,
) -> GraspedObject:
    """An object of closed surfaces, vertices and triangles each, that both hands hold alike.

    Its centre of mass is that of the surfaces' insides; what overlaps counts twice.
    """
    first = np.cumsum([0, *(len(vertices) for vertices, _ in surfaces)])
    vertices = np.vstack([each for each, _ in surfaces])
    triangles = np.vstack([each + k for (_, each), k in zip(surfaces, first, strict=False)])
    corners = vertices[triangles]
    volumes = np.linalg.det(corners)
    center = volumes @ corners.mean(axis=1) * 0.75 / volumes.sum()
    held = objects.of_solids(name, parts, grasps, finger_opening, center)
    return _with_surface(held, name, vertices, triangles)


def wine_glass_mesh() -> GraspedObject:
    """The wine glass as one surface."""
    glass = objects.object_by_name("wine_glass")
    return _with_surface(glass, "wine_glass_mesh", *turned(GLASS_OUTLINE, _SIDES))


def toy_table_mesh() -> GraspedObject:
    """The toy table as one surface."""
    table = objects.object_by_name("toy_table")
    boxes = [(part.vertices.min(axis=0), part.vertices.max(axis=0)) for part in table.parts]
    return _with_surface(table, "toy_table_mesh", *joined_boxes(boxes))


def _with_surface(
    held: GraspedObject, name: str, vertices: Array, triangles: Triangles
) -> GraspedObject:
    """The same with another mesh."""
    triangles = triangles.astype(np.int64)
    triangles.setflags(write=False)
    return replace(held, name=name, vertices=frozen_array(vertices), triangles=triangles)


_IN_ONE: dict[str, Callable[[], GraspedObject]] = {
    "wine_glass_mesh": wine_glass_mesh,
    "toy_table_mesh": toy_table_mesh,
}
_HOUSEHOLD: dict[str, Callable[[], GraspedObject]] = {
    "mug": mug,
    "bowl": bowl,
    "tray": tray,
    "bin": bin_,
    "drill": drill,
    "banana": banana,
}
SINGLE_MESHES: tuple[str, ...] = tuple(_IN_ONE)
"""Those of the paper's that are not convex, as one surface."""
HOUSEHOLD: tuple[str, ...] = tuple(_HOUSEHOLD)
ALL_OBJECTS: tuple[str, ...] = OBJECT_NAMES + SINGLE_MESHES + HOUSEHOLD


def object_by_name(name: str) -> GraspedObject:
    """Build an object, the bundled ones among them.

    Raises:
        ParameterError: no such object.
    """
    more = _IN_ONE | _HOUSEHOLD
    return more[name]() if name in more else objects.object_by_name(name)
