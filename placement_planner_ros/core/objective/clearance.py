"""The clearance objective: how far, on average, the object is from what stands around it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.scene.slope import greatest_slope
from placement_planner_ros.core.types import Array

_ROUNDING = 1e-6
"""m, more than single precision changes a clearance by."""


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
        self._slope: float | None = None  # of d_S, found when first asked for
        self._middle = self._points.mean(axis=0)
        self._spread = np.cov(self._points.T, bias=True)

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

    def upper_bounds(self, T_world_object: Array, pivot: Array, shift: Array, turn: Array) -> Array:
        """(n,) ±C of the poses, and what it may change by with the slope of d_S.

        A point at distance ρ from the pivot's vertical moves by at most
        shift + 2 sin(turn / 2) ρ, and the mean of ρ over B_o is at most the root of that of ρ².
        """
        if self._slope is None:
            self._slope = greatest_slope(self._field)
        R = T_world_object[:, :3, :3]
        arm = R @ self._middle + T_world_object[:, :3, 3] - pivot
        across = R[:, :2] @ self._spread
        radius = np.sqrt((arm[:, :2] ** 2).sum(axis=1) + (across * R[:, :2]).sum(axis=(1, 2)))
        moved_by = shift + 2.0 * np.sin(0.5 * np.minimum(turn, np.pi)) * radius
        bounds = self.values(T_world_object) + self._slope * moved_by + _ROUNDING
        return np.asarray(np.minimum(bounds, self._field.cap if self._sign > 0.0 else 0.0))


def thinned(points: Array) -> Array:
    """Every second, fourth or eighth of the (n, 3) voxel centres, spread evenly, 300 at least."""
    share = next((s for s in (8, 4, 2) if len(points) >= 300 * s), 1)
    index = [np.unique(np.round(line, 6), return_inverse=True)[1] for line in points.T]
    return np.asarray(points[(index[0] + 3 * index[1] + 5 * index[2]) % share == 0])
