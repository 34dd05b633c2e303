"""The paper's four objects and a book, made of convex solids, and how the YuMi's hands hold them.

A grasp is `T_tip_object`, the object's pose in the gripper base frame: the palm ends at
z = 0.0936, the finger pads (21 mm wide along y) reach to z = 0.1359 and close along x.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.types import Array, Index, frozen_array, frozen_integers
from placement_planner_ros.scenes.primitives import Colour, ConvexPrimitive, box, frustum

PALM = 0.098
"""m, depth in the tip frame at which a held object begins: 4 mm in front of the palm."""
STEM = 0.126
"""m, depth at which the fingers hold a stem or leg across: in the front half of the pads."""


@dataclass(frozen=True, slots=True, eq=False)
class GraspedObject:
    """An object and its grasps.

    Attributes:
        name: as on the command line.
        vertices: (n, 3) metres, in the object frame.
        triangles: (t, 3) indices, outward; every connected component is closed.
        center_of_mass: (3,) in the object frame.
        grasps: per arm, the poses T_tip_object in which its hand can hold the object.
        finger_opening: value of each finger joint at which the fingers touch the object, metres;
            the same for all grasps.
        parts: convex solids whose union it is.
    """

    name: str
    vertices: Array
    triangles: Index
    center_of_mass: Array
    grasps: Mapping[str, tuple[pin.SE3, ...]]
    finger_opening: float
    parts: tuple[ConvexPrimitive, ...]


def grasp(
    closing: Sequence[float], approach: Sequence[float], point: Sequence[float], depth: float
) -> pin.SE3:
    """T_tip_object of a hand that closes along `closing` and points along `approach`.

    Args:
        closing, approach: directions of the tip frame's x and z, in the object frame.
        point: a point of the object on the hand's axis.
        depth: its z in the tip frame, metres.
    """
    # columns are the tip's axes in the object frame
    x, z = (np.array(v, dtype=np.float64) / np.linalg.norm(v) for v in (closing, approach))
    rotation = np.column_stack([x, np.cross(z, x), z])
    return pin.SE3(rotation, np.array(point, dtype=np.float64) - depth * z).inverse()


def tilted(degrees: float) -> tuple[float, float, float]:
    """Direction +x, turned down by an angle."""
    angle = np.deg2rad(degrees)
    return float(np.cos(angle)), 0.0, -float(np.sin(angle))


def of_solids(
    name: str,
    parts: Sequence[ConvexPrimitive],
    grasps: Sequence[pin.SE3],
    finger_opening: float,
    center_of_mass: npt.ArrayLike,
) -> GraspedObject:
    """An object of solids that touch each other, which both hands hold alike."""
    # triangles count vertices on from those of the solids before
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    triangles = np.vstack([part.triangles + k for part, k in zip(parts, first, strict=False)])
    return GraspedObject(
        name=name,
        vertices=frozen_array(np.vstack([part.vertices for part in parts])),
        triangles=frozen_integers(triangles),
        center_of_mass=frozen_array(center_of_mass, (3,)),
        grasps={"left": tuple(grasps), "right": tuple(grasps)},
        finger_opening=finger_opening,
        parts=tuple(parts),
    )


_GREEN: Colour = (0.35, 0.75, 0.35)
GLASS_OUTLINE = (  # height, radius
    (0.000, 0.0285),
    (0.003, 0.0285),
    (0.012, 0.0040),
    (0.075, 0.0040),
    (0.120, 0.0420),
    (0.145, 0.0285),
)
"""Outline of the wine glass, metres."""


def _large_crayons_box() -> GraspedObject:
    """144 × 124 × 36 mm, held across its thickness: over either edge or over a corner."""
    x, y, z = 0.072, 0.062, 0.018
    grasps = (
        grasp((0, 0, 1), (1, 0, 0), (-x, 0, 0), PALM),
        grasp((0, 0, 1), (0, 1, 0), (0, -y, 0), PALM),
        grasp((0, 0, 1), (1, 1, 0), (-x, -y, 0), PALM),
    )
    parts = (box("large_crayons_box", (-x, -y, -z), (x, y, z), _GREEN),)
    return of_solids("large_crayons_box", parts, grasps, z, (0, 0, 0))


def _small_crayons_box() -> GraspedObject:
    """94 × 21 × 71 mm, held across its thickness: over either edge or over a corner."""
    x, y, z = 0.047, 0.0105, 0.0355
    grasps = (
        grasp((0, 1, 0), (1, 0, 0), (-x, 0, 0), PALM),
        grasp((0, 1, 0), (0, 0, -1), (0, 0, z), PALM),
        grasp((0, 1, 0), (1, 0, -1), (-x, 0, z), PALM),
    )
    parts = (box("small_crayons_box", (-x, -y, -z), (x, y, z), _GREEN),)
    return of_solids("small_crayons_box", parts, grasps, y, (0, 0, 0))


def _wine_glass() -> GraspedObject:
    """145 mm high, foot on the plane z = 0, held by its stem from the side.

    Being round, it can be turned about its axis by the placement; the grasps differ in height
    and in how far the hand points down (or, for standing on the rim, up).
    """
    parts = [
        # one solid between each two rings of the outline
        frustum(f"wine_glass/{k}", (below[1], above[1]), (below[0], above[0]), _GREEN, sides=32)
        for k, (below, above) in enumerate(pairwise(GLASS_OUTLINE))
    ]
    grasps = (
        grasp((0, 1, 0), tilted(0), (0, 0, 0.052), STEM),
        grasp((0, 1, 0), tilted(30), (0, 0, 0.034), STEM),
        grasp((0, 1, 0), tilted(-30), (0, 0, 0.060), STEM),
    )
    return of_solids("wine_glass", parts, grasps, 0.004, (0, 0, 0.050))


def _toy_table() -> GraspedObject:
    """Plate 110 × 70 × 6 mm on four legs 6 mm thick, 73 mm high, feet on the plane z = 0.

    Held by its plate from a long or a short side (to stand on its feet or a side), or by a leg
    from below (to stand on its plate or a side).
    """
    top, plate, leg = 0.073, 0.006, 0.006
    parts = [box("toy_table/plate", (-0.055, -0.035, top - plate), (0.055, 0.035, top), _GREEN)]
    # a leg near each corner of the plate
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
    return of_solids("toy_table", parts, grasps, plate / 2, (0, 0, 0.044))


def _book() -> GraspedObject:
    """140 × 30 × 200 mm, to be leaned; held across its thickness, low at a side or over its top."""
    x, y, z = 0.015, 0.070, 0.100
    grasps = (
        grasp((1, 0, 0), (0, 1, 0), (0, -y, -0.5 * z), PALM),
        grasp((1, 0, 0), (0, -1, 0), (0, y, -0.5 * z), PALM),
        grasp((1, 0, 0), (0, 1, 0), (0, -y, 0), PALM),
        grasp((1, 0, 0), (0, -1, 0), (0, y, 0), PALM),
        grasp((1, 0, 0), (0, 0, -1), (0, 0, z), PALM),
    )
    parts = (box("book", (-x, -y, -z), (x, y, z), _GREEN),)
    return of_solids("book", parts, grasps, x, (0, 0, 0))


_OBJECTS: dict[str, Callable[[], GraspedObject]] = {
    "large_crayons_box": _large_crayons_box,
    "small_crayons_box": _small_crayons_box,
    "wine_glass": _wine_glass,
    "toy_table": _toy_table,
    "book": _book,
}
BUNDLED_OBJECTS: tuple[str, ...] = tuple(_OBJECTS)
OBJECT_NAMES: tuple[str, ...] = BUNDLED_OBJECTS[:4]
"""The paper's."""


def object_by_name(name: str) -> GraspedObject:
    """Build a bundled object.

    Raises:
        ParameterError: no such object; the message lists those there are.
    """
    if name not in _OBJECTS:
        raise ParameterError("object", name, f"choose one of {', '.join(BUNDLED_OBJECTS)}")
    return _OBJECTS[name]()
