"""The clearance objective: how far, on average, the object is from what stands around it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.types import Array


class Clearance:
    """ξ = ±C(x), the mean distance d_S over the object's volume points B_o.

    Args:
        sign: +1 maximises clearance, -1 minimises it.
    """

    def __init__(self, context: ObjectiveContext, sign: float) -> None:
        self._field = context.environment.clearance
        self._points = context.body.volume_points
        self._some_points = thinned(self._points)
        self._sign = sign

    def __call__(self, T_world_object: pin.SE3) -> float:
        """±C(x), metres."""
        value, _ = self._field.mean_clearance(T_world_object.homogeneous, self._points)
        return self._sign * value

    def values(self, T_world_object: Array) -> Array:
        """(n,) ±C of the (n, 4, 4) poses, metres."""
        values, _ = self._field.mean_clearance_batch(T_world_object, self._points)
        return self._sign * values

    def estimates(self, T_world_object: Array) -> Array:
        """(n,) ±C over a few hundred of B_o, metres."""
        values, _ = self._field.mean_clearance_batch(T_world_object, self._some_points)
        return self._sign * values

    def gradient(self, T_world_object: pin.SE3) -> Array:
        """±∂C/∂(x, y, e_z)."""
        _, gradient = self._field.mean_clearance(T_world_object.homogeneous, self._points)
        return np.asarray(self._sign * gradient)


def thinned(points: Array) -> Array:
    """Every second, fourth or eighth of the (n, 3) voxel centres, spread evenly, 300 at least."""
    share = next((s for s in (8, 4, 2) if len(points) >= 300 * s), 1)
    index = [np.unique(np.round(line, 6), return_inverse=True)[1] for line in points.T]
    return np.asarray(points[(index[0] + 3 * index[1] + 5 * index[2]) % share == 0])
