"""Leaves the robot and what it holds out of a cloud."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.body import Body
from placement_planner_ros.core.robot.collision_shapes import Shape, polytope, shape_of
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array


def outside_robot(
    points: Array,
    robot: Robot,
    q: Array,
    arms: Sequence[Arm],
    body: Body | None,
    padding: float,
) -> npt.NDArray[np.bool_]:
    """Which of the (n, 3) points are on neither the robot nor the held object.

    Each link counts as its convex parts, a mesh that is not convex as its hull. The object is
    taken to be in every grasp of every candidate arm.

    Args:
        q: (nq,) configuration.
        body: the held object, None for an empty hand.
        padding: metres by which every part grows.
    """
    kept = np.ones(len(points), dtype=bool)
    data = robot.model.createData()
    geometry_data = robot.geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.geometry, geometry_data, q)
    for i, shape in enumerate(robot.geometry.geometryObjects):
        normals, offsets = _planes(shape_of(shape.geometry, shape.name))
        _drop_inside(points, kept, geometry_data.oMg[i], normals, offsets + padding)
    if body is not None:
        for arm in arms:
            T_world_tip = robot.link_pose(q, arm.tip_frame)
            for grasp in arm.grasps:
                for part in body.parts:
                    _drop_inside(
                        points, kept, T_world_tip * grasp, part.normals, part.offsets + padding
                    )
    return kept


def _planes(shape: Shape) -> tuple[Array, Array]:
    """Planes n·x ≤ d of the shape's hull, dilated by its radius."""
    radius = max(s.radius for s in shape.sets)
    if len(shape.sets) == 1 and len(shape.sets[0].normals):
        hull = shape.sets[0]
    else:
        vertices = np.vstack([s.vertices for s in shape.sets])
        if np.linalg.matrix_rank(vertices - vertices[0], tol=1e-6) < 3:
            # A sphere, a capsule or a flat sheet: its box stands for it.
            low, high = vertices.min(axis=0) - radius, vertices.max(axis=0) + radius
            return np.vstack([np.eye(3), -np.eye(3)]), np.concatenate([high, -low])
        hull = polytope(vertices)
    return hull.normals, hull.offsets + radius


def _drop_inside(
    points: Array,
    kept: npt.NDArray[np.bool_],
    T_world_part: pin.SE3,
    normals: Array,
    offsets: Array,
) -> None:
    """Clear `kept` where n·x ≤ d for every plane, which is in the part's frame."""
    world_normals = normals @ T_world_part.rotation.T
    world_offsets = offsets + world_normals @ T_world_part.translation
    candidates = np.flatnonzero(kept)
    for normal, offset in zip(world_normals, world_offsets, strict=True):
        candidates = candidates[points[candidates] @ normal <= offset]
        if len(candidates) == 0:
            return
    kept[candidates] = False
