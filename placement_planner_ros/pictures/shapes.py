"""Triangle meshes for pictures: a robot's shapes, tubes, the edges of target volumes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
import trimesh
from scipy.spatial import ConvexHull

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.pictures.rendering import Mesh, Viewpoint, joined
from placement_planner_ros.scenes.primitives import Colour

Triangles = npt.NDArray[np.int64]

PLACED: Colour = (0.15, 0.70, 0.25)
LINK: Colour = (0.88, 0.88, 0.90)
HAND: Colour = (0.35, 0.36, 0.42)
VOLUME: Colour = (0.85, 0.15, 0.55)
_EDGE_RADIUS_M = 0.0015
"""Of the tubes that the edges of V are drawn as."""


def moved(vertices: Array, T: pin.SE3) -> Array:
    """Vertices (n, 3) at T."""
    return np.asarray(np.asarray(vertices) @ T.rotation.T + T.translation)


def box_corners(lower: Array, upper: Array) -> Array:
    """(8, 3): bit k of the row says whether coordinate k is the upper one."""
    is_upper = (np.arange(8)[:, None] >> np.arange(3)) & 1
    return np.where(is_upper == 1, upper, lower)


class RobotShapes:
    """The collision shapes of a robot as meshes, made once for many configurations.

    Args:
        hand_links: links in the darker colour, such as an arm's touch links.
    """

    def __init__(self, robot: Robot, hand_links: Sequence[str] = ()) -> None:
        self._robot = robot
        self._shapes = [
            (*_shape_mesh(solid.geometry), HAND if link in hand_links else LINK)
            for solid, link in zip(
                robot.geometry.geometryObjects, robot.geometry_links, strict=True
            )
        ]

    def at(self, q: Array) -> list[Mesh]:
        """Each shape at q (nq,), in the order of `Robot.geometry_links`."""
        poses = self._robot.geometry_poses(q)
        return [
            Mesh(moved(vertices, T), triangles, colour)
            for (vertices, triangles, colour), T in zip(self._shapes, poses, strict=True)
        ]


def _shape_mesh(shape: coal.CollisionGeometry) -> tuple[Array, Triangles]:
    """Vertices (n, 3) and triangles (t, 3) of a collision shape in its own frame."""
    if isinstance(shape, coal.BVHModelBase):
        indices = [[shape.tri_indices(i)[k] for k in range(3)] for i in range(shape.num_tris)]
        return np.array(shape.vertices()), np.array(indices, dtype=np.int64)
    if isinstance(shape, coal.ConvexBase):
        vertices = np.array(shape.points())
        return vertices, ConvexHull(vertices).simplices.astype(np.int64)
    if isinstance(shape, coal.Box):
        made = trimesh.creation.box(2.0 * shape.halfSide)
    elif isinstance(shape, coal.Sphere):
        made = trimesh.creation.icosphere(subdivisions=2, radius=shape.radius)
    elif isinstance(shape, coal.Cylinder):
        made = trimesh.creation.cylinder(shape.radius, 2.0 * shape.halfLength)
    elif isinstance(shape, coal.Capsule):
        made = trimesh.creation.capsule(2.0 * shape.halfLength, shape.radius)
        made.apply_translation(-made.bounds.mean(axis=0))
    else:
        raise TypeError(f"cannot draw a {type(shape).__name__}")
    return np.array(made.vertices), np.array(made.faces, dtype=np.int64)


def tube(points: Array, radius: float, colour: Colour) -> Mesh:
    """A tube along points (n, 3), n at least 2; m."""
    parts = [
        trimesh.creation.cylinder(radius, segment=np.array(ends), sections=6)
        for ends in pairwise(points)
        if np.linalg.norm(ends[1] - ends[0]) > 1e-6
    ]
    (mesh,) = joined(Mesh(np.array(p.vertices), np.array(p.faces), colour) for p in parts)
    return mesh


def volume_edges(volume: TargetVolume) -> list[Mesh]:
    """The edges of V's boxes."""
    return [
        tube(box_corners(*box)[[i, i | 1 << axis]], _EDGE_RADIUS_M, VOLUME)
        for box in volume.joined
        for i in range(8)
        for axis in range(3)
        if not i >> axis & 1
    ]


def see_through(view: Viewpoint, points: Array, solids: Sequence[Mesh]) -> list[Mesh]:
    """The solids, translucent where they (their hulls) stand before the points (n, 3)."""
    # forty lines of sight, each from near the eye to just before its target
    targets = points[:: max(1, len(points) // 40)]
    shares = np.linspace(0.3, 0.98, 120)[:, None, None]
    along = (view.eye + shares * (targets - view.eye)).reshape(-1, 3)
    result = []
    for solid in solids:
        # a line that passes through the hull is hidden
        faces = ConvexHull(solid.vertices).equations
        depth = -(along @ faces[:, :3].T + faces[:, 3]).max(axis=1)
        hidden = (depth.reshape(len(shares), -1) > 1e-3).any(axis=0).mean()
        result.append(replace(solid, alpha=0.28) if hidden > 0.1 else solid)
    return result
