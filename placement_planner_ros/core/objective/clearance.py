"""The clearance objective: how far, on average, the object is from what stands around it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.objective.objective import ObjectiveContext, PoseRanges
from placement_planner_ros.core.objective.supporting_faces import SupportingFaces
from placement_planner_ros.core.scene.clearance import ClearanceField, most_change
from placement_planner_ros.core.scene.clearance_table import CAP
from placement_planner_ros.core.types import Array


class Clearance:
    """ξ = ±C(x), the mean distance d_S over the object's volume points B_o.

    For an object that stands along the normal of a slope, the surfaces of that slope are what it
    stands on, and sideways is along them (`Incline.clearance`).

    Args:
        sign: 1 maximises clearance, -1 minimises it.
    """

    bounded = True

    def __init__(self, context: ObjectiveContext, sign: float = 1.0) -> None:
        self._environment = context.environment
        self._standing = SupportingFaces(context) if context.body.faces else None
        self._points = context.body.volume_points
        self._some_points = thinned_points(self._points, 300)
        self._few_points = thinned_points(self._points, 40)
        self._size = float(np.linalg.norm(np.ptp(context.body.vertices, axis=0)))
        self._sign = sign
        self._envelopes: dict[tuple[int, float], ClearanceField] = {}

    def __call__(self, T_world_object: pin.SE3) -> float:
        """±C(x), metres."""
        return float(self.values(T_world_object.homogeneous[None])[0])

    def values(self, T_world_object: Array) -> Array:
        """(n,) ±C of the (n, 4, 4) poses, metres."""
        return self._sign * self._clearance(T_world_object, self._points)[0]

    def estimates(self, T_world_object: Array) -> Array:
        """(n,) ±C over a few hundred of B_o, metres."""
        return self._sign * self._clearance(T_world_object, self._some_points)[0]

    def gradient(self, T_world_object: pin.SE3) -> Array:
        """±∂C/∂(x, y, e_z)."""
        T = T_world_object.homogeneous[None]
        return np.asarray(self._sign * self._clearance(T, self._points, slopes=True)[1][0])

    def most_around(self, ranges: PoseRanges, rough: bool = False) -> Array:
        """(n,) what ±C does not exceed at any pose of each range, metres."""
        return self._most(ranges, self._sign, rough)

    def around(self, ranges: PoseRanges, rough: bool = False) -> tuple[Array, Array]:
        """(n,) what C is not below and (n,) not above at any pose of each range, metres."""
        return -self._most(ranges, -1.0, rough), self._most(ranges, 1.0, rough)

    def _most(self, ranges: PoseRanges, sign: float, rough: bool) -> Array:
        """(n,) what sign · C does not exceed: within a plane heights above it stay the same, and a
        mean changes by no more than its points move."""
        # What it is at the middle of each range, and how far points move from there.
        moved = ranges.shift + ranges.chord * self._radii(ranges)
        values = np.empty(len(moved))
        # Where points move by more than a few of them are off, these tell as much.
        far = rough & (moved > 0.1 * self._size)
        near = self._some_points if rough else self._points
        for rows, points in (far, self._few_points), (~far, near):
            values[rows] = self._clearance(ranges.T[rows], points, sign=sign)[0]
        most = sign * values + most_change(moved, max(field.pixel for field in self._fields))
        return np.minimum(most, CAP if sign > 0.0 else 0.0)

    def _radii(self, ranges: PoseRanges) -> Array:
        """(n,) m, root mean square distance of B_o from the axis of each range."""
        # Moments of B_o about the pivot: |q|² less the part along the axis.
        mean = self._points.mean(axis=0) if len(self._points) else np.zeros(3)
        second = self._points.T @ self._points / max(len(self._points), 1)
        R, off = ranges.T[:, :3, :3], ranges.T[:, :3, 3] - ranges.pivot
        mean = R @ mean
        along = (R.transpose(0, 2, 1) @ ranges.axis[..., None])[..., 0]
        off_along = (ranges.axis * off).sum(axis=1)
        square = np.trace(second) + 2.0 * (mean * off).sum(axis=1) + (off * off).sum(axis=1)
        square -= ((along @ second) * along).sum(axis=1)
        square -= 2.0 * off_along * (ranges.axis * mean).sum(axis=1) + off_along**2
        return np.sqrt(np.maximum(square, 0.0))

    @property
    def _fields(self) -> list[ClearanceField]:
        """That of level ground, then that of each incline."""
        return [self._environment.clearance, *(one.clearance for one in self._environment.inclines)]

    def _field(self, k: int, sign: float) -> ClearanceField:
        """One of them; where there is a sign, what sign · d_S is nowhere above."""
        if sign and (k, sign) not in self._envelopes:
            self._envelopes[k, sign] = self._fields[k].envelope(sign)
        return self._envelopes[k, sign] if sign else self._fields[k]

    def _clearance(
        self, T: Array, points: Array, slopes: bool = False, sign: float = 0.0
    ) -> tuple[Array, Array]:
        """C (n,), and with `slopes` its gradient (n, 3), at poses (n, 4, 4), each with what it
        stands on; with a sign, what sign · C is not above."""
        # Without inclines one field tells all.
        if not self._environment.inclines or self._standing is None:
            return self._field(0, sign).mean_clearance(T, points, slopes)
        stands_on = self._standing.at(T).slope
        values, gradients = np.empty(len(T)), np.empty((len(T), 3))
        # Poses on one incline are looked up in its field, with its slope taken out.
        for k in np.unique(stands_on):
            rows = stands_on == k
            poses = self._environment.inclines[k - 1].sheared(T[rows]) if k > 0 else T[rows]
            field = self._field(int(k), sign)
            values[rows], gradients[rows] = field.mean_clearance(poses, points, slopes)
        return values, gradients


def thinned_points(points: Array, number: int) -> Array:
    """Some of the (n, 3) voxel centres, spread evenly, at least so many if there are."""
    # Keep a share by a sum of the grid indices whose factors spread them along all three axes.
    index = [np.unique(np.round(line, 6), return_inverse=True)[1] for line in points.T]
    place = index[0] + 27 * index[1] + 23 * index[2]
    some = (np.asarray(points[place % share == 0]) for share in (64, 32, 16, 8, 4, 2))
    return next((kept for kept in some if len(kept) >= number), points)
