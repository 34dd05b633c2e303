"""An object as the YuMi's hands hold it.

A grasp is `T_tip_object`, the object's pose in the gripper base frame: the palm ends at
z = 0.0936, the finger pads (21 mm wide along y) reach to z = 0.1359 and close along x.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.types import Array, frozen_array
from placement_planner_ros.scenes.primitives import ConvexPrimitive

PALM = 0.098
"""Depth in the tip frame at which a held object begins: 4 mm in front of the palm."""
STEM = 0.126
"""Depth at which the fingers hold a stem or leg across: in the front half of the pads."""


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
        parts: convex solids whose union it is; those of the household's things may overlap.
    """

    name: str
    vertices: Array
    triangles: npt.NDArray[np.int64]
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
    x, z = (np.array(v, dtype=np.float64) / np.linalg.norm(v) for v in (closing, approach))
    rotation = np.column_stack([x, np.cross(z, x), z])
    return pin.SE3(rotation, np.array(point, dtype=np.float64) - depth * z).inverse()


def tilted(degrees: float) -> tuple[float, float, float]:
    """Direction +x, turned down by an angle."""
    angle = np.deg2rad(degrees)
    return float(np.cos(angle)), 0.0, -float(np.sin(angle))


def assemble(
    name: str,
    surfaces: Sequence[tuple[Array, npt.NDArray[np.int64]]],
    parts: Sequence[ConvexPrimitive],
    grasps: Sequence[pin.SE3],
    finger_opening: float,
    center_of_mass: npt.ArrayLike | None = None,
) -> GraspedObject:
    """An object that both hands hold alike.

    Args:
        surfaces: closed ones, vertices (n, 3) and triangles (t, 3); all together its mesh.
        center_of_mass: of the surfaces' insides unless given; what overlaps counts twice then.
    """
    counts = np.cumsum([0, *(len(vertices) for vertices, _ in surfaces)])
    vertices = np.vstack([each for each, _ in surfaces])
    triangles = np.vstack(
        [each + count for (_, each), count in zip(surfaces, counts, strict=False)]
    ).astype(np.int64)
    triangles.setflags(write=False)
    if center_of_mass is None:
        corners = vertices[triangles]
        volumes = np.linalg.det(corners)
        center_of_mass = volumes @ corners.mean(axis=1) * 0.75 / volumes.sum()
    return GraspedObject(
        name=name,
        vertices=frozen_array(vertices),
        triangles=triangles,
        center_of_mass=frozen_array(center_of_mass, (3,)),
        grasps={"left": tuple(grasps), "right": tuple(grasps)},
        finger_opening=finger_opening,
        parts=tuple(parts),
    )


def surfaces_of(parts: Sequence[ConvexPrimitive]) -> list[tuple[Array, npt.NDArray[np.int64]]]:
    """Vertices (n, 3) and triangles (t, 3) of each."""
    return [(part.vertices, part.triangles) for part in parts]
