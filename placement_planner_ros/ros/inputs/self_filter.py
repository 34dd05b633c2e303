"""Leaves the robot and what it holds out of a cloud."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.shapes import Shape, polytope, shape_of
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """A convex solid n·x ≤ d within a box, in the frame of what carries it."""

    normals: Array
    offsets: Array
    center: Array
    half: Array


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """The space that robot and held object fill at one configuration.

    Attributes:
        lower, upper: (p, 3) boxes around its convex parts.
        first: (p + 1,) the first plane of each.
        normals, offsets: (f, 3) and (f,) of the planes, in the world.
    """

    lower: Array
    upper: Array
    first: npt.NDArray[np.int64]
    normals: Array
    offsets: Array

    @classmethod
    def of(
        cls, robot: Robot, q: Array, arms: Sequence[Arm], body: Body | None, padding: float
    ) -> Outline:
        """Each link as its convex parts, a mesh that is not convex as its hull, and the object in
        every grasp of every candidate arm.

        Args:
            q: (nq,) configuration.
            body: what the hands hold, None for nothing.
            padding: metres by which every part grows.
        """
        placed = list(zip(robot.geometry_poses(q), _robot_parts(robot), strict=True))
        solids = () if body is None else body.parts
        held = [_part(part.vertices, part.normals, part.offsets, 0.0) for part in solids]
        for arm in arms:
            T_world_tip = robot.link_pose(q, arm.tip_frame)
            placed += [(T_world_tip * grasp, part) for grasp in arm.grasps for part in held]
        first = np.cumsum([0, *(len(part.offsets) for _, part in placed)])
        normals = np.vstack([part.normals @ T.rotation.T for T, part in placed])
        shifts = np.repeat([T.translation for T, _ in placed], np.diff(first), axis=0)
        offsets = np.concatenate([part.offsets for _, part in placed]) + padding
        offsets += np.einsum("ij,ij->i", normals, shifts)
        centers = np.array([T.act(part.center) for T, part in placed])
        halves = np.array([np.abs(T.rotation) @ part.half for T, part in placed]) + padding
        return cls(centers - halves, centers + halves, first, normals, offsets)

    def outside(self, points: Array) -> npt.NDArray[np.bool_]:
        """Which of the (n, 3) points are in none of it."""
        return _outside(
            np.ascontiguousarray(points),
            self.lower,
            self.upper,
            self.first,
            self.normals,
            self.offsets,
        )


def outside_robot(
    points: Array,
    robot: Robot,
    q: Array,
    arms: Sequence[Arm],
    body: Body | None,
    padding: float,
) -> npt.NDArray[np.bool_]:
    """Which of the (n, 3) points are outside of an `Outline`."""
    return Outline.of(robot, q, arms, body, padding).outside(points)


@kernel(nogil=True)
def _outside(
    points: Array,
    lower: Array,
    upper: Array,
    first: npt.NDArray[np.int64],
    normals: Array,
    offsets: Array,
) -> npt.NDArray[np.bool_]:
    """Points (n, 3) in no part k: planes first[k] … first[k + 1] − 1, box lower[k] … upper[k]."""
    outside = np.ones(len(points), dtype=np.bool_)
    everything_lower = np.array([np.min(lower[:, i]) for i in range(3)])
    everything_upper = np.array([np.max(upper[:, i]) for i in range(3)])
    for i in range(len(points)):
        x, y, z = points[i]
        if (
            x < everything_lower[0]
            or x > everything_upper[0]
            or y < everything_lower[1]
            or y > everything_upper[1]
            or z < everything_lower[2]
            or z > everything_upper[2]
        ):
            continue
        for k in range(len(lower)):
            if (
                x < lower[k, 0]
                or x > upper[k, 0]
                or y < lower[k, 1]
                or y > upper[k, 1]
                or z < lower[k, 2]
                or z > upper[k, 2]
            ):
                continue
            inside = True
            for p in range(first[k], first[k + 1]):
                if normals[p, 0] * x + normals[p, 1] * y + normals[p, 2] * z > offsets[p]:
                    inside = False
                    break
            if inside:
                outside[i] = False
                break
    return outside


@lru_cache(maxsize=2)
def _robot_parts(robot: Robot) -> tuple[_Part, ...]:
    """Each of the robot's geometries in its own frame."""
    return tuple(
        _hull(shape_of(shape.geometry, shape.name)) for shape in robot.geometry.geometryObjects
    )


def _hull(shape: Shape) -> _Part:
    radius = max(s.radius for s in shape.sets)
    vertices = np.vstack([s.vertices for s in shape.sets])
    if len(shape.sets) == 1 and len(shape.sets[0].normals):
        return _part(vertices, shape.sets[0].normals, shape.sets[0].offsets, radius)
    if np.linalg.matrix_rank(vertices - vertices[0], tol=1e-6) == 3:
        hull = polytope(vertices)
        return _part(vertices, hull.normals, hull.offsets, radius)
    # A sphere, a capsule or a flat sheet: its box stands for it.
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    normals = np.vstack([np.eye(3), -np.eye(3)])
    return _part(vertices, normals, np.concatenate([high, -low]), radius)


def _part(vertices: Array, normals: Array, offsets: Array, radius: float) -> _Part:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return _Part(normals, offsets + radius, (low + high) / 2, (high - low) / 2 + radius)
