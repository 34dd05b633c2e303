"""Balls that lie within the object, so that what they hold is in it."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.types import Array


def inner_balls(body: Body, radius: float) -> Array:
    """(n, 4) centres and radii of balls within convex pieces of the body, larger than that, the
    largest first; none whose centre lies in the inner half of a larger one."""
    points = body.volume_points
    depths = [(s.offsets - points @ s.normals.T).min(axis=1) for s in body.solids]
    depth = np.max([np.zeros(len(points)), *depths], axis=0)
    left = np.flatnonzero(depth > radius)
    left = left[np.argsort(-depth[left], kind="stable")]
    chosen: list[int] = []
    while len(left):
        chosen.append(left[0])
        away = np.linalg.norm(points[left] - points[left[0]], axis=1)
        left = left[away > 0.5 * depth[left[0]]]
    return np.column_stack([points, depth])[chosen]
