"""The clearance objective: how far, on average, the object is from what stands around it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.types import Array, upright


class Clearance:
    """ξ = ±C(x), the mean distance d_S over the object's volume points B_o.

    For an object that stands along the normal of a slope, the surfaces of that slope are what it
    stands on, and sideways is along them (`Incline.clearance`).

    Args:
        sign: +1 maximises clearance, -1 minimises it.
    """

    def __init__(self, context: ObjectiveContext, sign: float) -> None:
        self._field = context.environment.clearance
        self._inclines = context.environment.inclines
        self._normals = np.array([upright(each.slope)[:, 2] for each in self._inclines])
        self._faces = np.array([face.normal for face in context.body.faces]).reshape(-1, 3)
        self._points = context.body.volume_points
        self._some_points = thinned_points(self._points)
        self._sign = sign

    def __call__(self, T_world_object: pin.SE3) -> float:
        """±C(x), metres."""
        values, _ = self._clearance(T_world_object.homogeneous[None], self._points, False)
        return self._sign * float(values[0])

    def values(self, T_world_object: Array) -> Array:
        """(n,) ±C of the (n, 4, 4) poses, metres."""
        values, _ = self._clearance(T_world_object, self._points, False)
        return self._sign * values

    def estimates(self, T_world_object: Array) -> Array:
        """(n,) ±C over a few hundred of B_o, metres."""
        values, _ = self._clearance(T_world_object, self._some_points, False)
        return self._sign * values

    def gradient(self, T_world_object: pin.SE3) -> Array:
        """±∂C/∂(x, y, e_z)."""
        _, gradients = self._clearance(T_world_object.homogeneous[None], self._points, True)
        return np.asarray(self._sign * gradients[0])

    def _clearance(self, T: Array, points: Array, slopes: bool) -> tuple[Array, Array]:
        """C (n,), and with `slopes` its gradient (n, 3), at poses (n, 4, 4), each with what it
        stands on."""
        if not self._inclines:
            return self._field.mean_clearance_batch(T, points, slopes)
        stands_on = self._stands_on(T)
        values, gradients = np.empty(len(T)), np.empty((len(T), 3))
        # Poses on one incline are looked up in its field, with its slope taken out.
        for k in np.unique(stands_on):
            rows, field, poses = stands_on == k, self._field, T
            if k > 0:
                field, poses = self._inclines[k - 1].clearance, self._inclines[k - 1].sheared(T)
            values[rows], gradients[rows] = field.mean_clearance_batch(poses[rows], points, slopes)
        return values, gradients

    def _stands_on(self, T: Array) -> npt.NDArray[np.int64]:
        """(n,) the incline against whose normal a face of the object points, from 1 on; 0 for level
        ground."""
        # How far each face points against each normal.
        normals = np.vstack([[0.0, 0.0, 1.0], self._normals])
        down = T[:, :3, :3] @ self._faces.T  # (n, 3, faces)
        return np.asarray((normals @ down).min(axis=2).argmin(axis=1))


def thinned_points(points: Array) -> Array:
    """Every second, fourth or eighth of the (n, 3) voxel centres, spread evenly, 300 at least."""
    # Keep a share by the sum of the grid indices, which spreads them.
    share = next((s for s in (8, 4, 2) if len(points) >= 300 * s), 1)
    index = [np.unique(np.round(line, 6), return_inverse=True)[1] for line in points.T]
    return np.asarray(points[(index[0] + 3 * index[1] + 5 * index[2]) % share == 0])
