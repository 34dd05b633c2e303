"""d_S, the distance to what was measured that the clearance objective averages.

`clearance_table` holds it; here it is asked for, at points and as the mean over a body.
"""

from __future__ import annotations

import math
from copy import copy

import numpy as np
from numba import njit

from placement_planner_ros.core.scene.clearance_table import CAP, VOXEL_M, ClearanceTable, new_table
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.rasters import Field
from placement_planner_ros.core.types import LEVEL, Array, Slope, TargetVolume
from placement_planner_ros.core.uncounted import Uncounted

_SINGLE_PRECISION = 100.0 * float(np.finfo(np.float32).eps)
"""More than the slopes of an envelope are off by, in parts."""


class ClearanceField:
    """d_S: distance sideways and upwards to obstacles in V and around it, capped.

    Values are kept in V and up to `AROUND_M` beside it; further away the nearest counts. Nothing
    that ends below a point counts for it, so d_S jumps where a thing ends beside it. A
    point stands for what is around it, from half a voxel below to half a voxel above: its value is
    the mean of d_S over this height. So the clearance of a body is continuous in z too.

    What a body stands on does not count, and may rise by the contact tolerance above its lowest
    point: what of the body is lower than `LIFT_M` above that point is judged at that height.

    Args:
        obstacles: their points that lie in V, grown by `beyond`, count.
        volume: V.
        beyond: how far outside V things count, metres: 0 is the paper's definition.
        slope: heights are those above a plane of this slope through the origin, and so are those of
            all that is asked for.
    """

    def __init__(
        self,
        obstacles: ObstacleSet,
        volume: TargetVolume,
        beyond: float = 0.0,
        slope: Slope = LEVEL,
    ) -> None:
        self._table = new_table(obstacles, volume, beyond, slope)

    @property
    def pixel(self) -> float:
        """Of the raster, metres."""
        return self._table.pixel

    def envelope(self, sign: float) -> ClearanceField:
        """What sign · d_S is nowhere above, from pixel to neighbour by no more than their distance.

        d_S itself does nearly so, but that the nearest is handed on by mistake at times.
        """
        values = np.float32(sign) * self._table.values
        _raise_to_slope(values, np.float32(self.pixel))
        values *= np.float32(sign)
        values.setflags(write=False)
        result = copy(self)
        result._table = self._table._replace(values=values)
        return result

    def distance(self, points: Array) -> Array:
        """(n,) d_S around the (n, 3) points, whatever they may stand on, metres."""
        T = np.tile(np.eye(4), (len(points), 1, 1))
        T[:, :3, 3] = points
        table, origin = self._table._replace(lift=0.0), _contiguous_view(np.zeros((1, 3)))
        return np.asarray(_mean_clearance(table, _contiguous_view(T), origin, False)[0])

    def mean_clearance(
        self, T_world_object: Array, points: Array, slopes: bool = True
    ) -> tuple[Array, Array]:
        """C(x) of the clearance objective, and ∂C/∂(x, y, e_z) about the object's origin.

        Args:
            T_world_object: (m, 4, 4).
            points: (n, 3), B_o in the object frame.
            slopes: without, no change is told, which takes less time.

        Returns:
            (m,) mean of d_S over B_o, metres; (m, 3) its change per metre, metre and radian.
        """
        return _mean_clearance(
            self._table, _contiguous_view(T_world_object), _contiguous_view(points), slopes
        )


def most_change(moved: Array, pixel: float) -> Array:
    """(n,) m, by which the mean over points that move sideways by (n,) m (root mean square) changes
    at most in an envelope.

    Within a pixel the slope is √2 at most. From afar, from the corners of one pixel to those of
    another, by which values are weighted, it is hypot(moved, pixel), along eight directions.
    """
    eight = math.sqrt(4.0 - 2.0 * math.sqrt(2.0))
    change = np.minimum(math.sqrt(2.0) * moved, eight * np.hypot(moved, pixel))
    return np.asarray(change * (1.0 + _SINGLE_PRECISION))


def _contiguous_view(values: Array) -> Array:
    """Read-only, so that a kernel compiles once, whatever it is given."""
    view = np.ascontiguousarray(values, dtype=np.float64).view()
    view.setflags(write=False)
    return view


@njit(cache=True, nogil=True)
def _raise_to_slope(values: Field, pixel: np.float32) -> None:
    """Raise (slices, nx, ny, 2) values to where pixels are no further apart than their distance."""
    slices, nx, ny, faces = values.shape
    straight, aslant = pixel, pixel * np.float32(math.sqrt(2.0))
    for layer in range(slices * faces):
        s, face = layer // faces, layer % faces
        # two sweeps hand the higher values on, against each other
        for sweep in range(2):
            step = 1 - 2 * sweep
            for row in range(nx):
                i = row if step > 0 else nx - 1 - row
                m = i - step
                for column in range(ny):
                    j = column if step > 0 else ny - 1 - column
                    # no lower than the neighbours swept before, less their distance
                    least = values[s, i, j, face]
                    if 0 <= m < nx:
                        least = max(least, values[s, m, j, face] - straight)
                        if j > 0:
                            least = max(least, values[s, m, j - 1, face] - aslant)
                        if j + 1 < ny:
                            least = max(least, values[s, m, j + 1, face] - aslant)
                    if 0 <= j - step < ny:
                        least = max(least, values[s, i, j - step, face] - straight)
                    values[s, i, j, face] = least


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _voxel_mean(table: ClearanceTable, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Mean of d_S over a voxel's height around a point, and its change along x and y."""
    values, faces = table.values, table.faces
    slices, nx, ny = values.shape[0], values.shape[1], values.shape[2]
    # the four pixels around, the nearest of the raster beside it
    u, v = (x - table.origin[0]) / table.pixel, (y - table.origin[1]) / table.pixel
    in_x, in_y = 0.0 <= u <= nx - 1.0, 0.0 <= v <= ny - 1.0
    u, v = min(max(u, 0.0), nx - 1.0), min(max(v, 0.0), ny - 1.0)
    i, j = min(int(u), nx - 2), min(int(v), ny - 2)
    u -= i
    v -= j
    low, top = z - 0.5 * VOXEL_M, z + 0.5 * VOXEL_M
    total, along_x, along_y = 0.0, 0.0, 0.0
    # the slice that this lies in: the first whose upper face is above
    s = np.searchsorted(faces[1:], low, side="right")
    # slice by slice, what of the voxel lies in it, at the middle of that
    while low < top and s < slices:
        end = min(faces[s + 1], top)
        share = (end - low) / VOXEL_M
        # below the lowest slice its lower face holds
        w = max(0.5 * (low + end) - faces[s], 0.0) / (faces[s + 1] - faces[s])
        # at each of the four pixels, between the faces of the slice
        a = values[s, i, j, 0] * (1.0 - w) + values[s, i, j, 1] * w
        b = values[s, i, j + 1, 0] * (1.0 - w) + values[s, i, j + 1, 1] * w
        c = values[s, i + 1, j, 0] * (1.0 - w) + values[s, i + 1, j, 1] * w
        d = values[s, i + 1, j + 1, 0] * (1.0 - w) + values[s, i + 1, j + 1, 1] * w
        # then between these along y, and along x
        near, far = a + (b - a) * v, c + (d - c) * v
        total += share * (near + (far - near) * u)
        # beside the raster nothing changes along that axis
        if in_x:
            along_x += share * (far - near) / table.pixel
        if in_y:
            along_y += share * ((b - a) * (1.0 - u) + (d - c) * u) / table.pixel
        low = end
        s += 1
    total += max(top - low, 0.0) / VOXEL_M * CAP  # above all that ends
    return total, along_x, along_y


@njit(cache=True, nogil=True)
def _mean_clearance(
    table: ClearanceTable, T_world_object: Array, points: Array, slopes: bool
) -> tuple[Array, Array]:
    """(m,) mean of d_S over the (n, 3) points at each of the (m, 4, 4) poses; (m, 3) gradients, 0
    unless `slopes`.

    A turn by e_z about the object's origin moves a point at (rx, ry) from it along (-ry, rx).
    """
    m, n = len(T_world_object), len(points)
    means = np.zeros(m)
    gradients = np.zeros((m, 3))
    for t in range(m):
        T = T_world_object[t]
        # what of the body is judged higher up than it is
        lowest = np.inf
        for p in range(n):
            up = T[2, 0] * points[p, 0] + T[2, 1] * points[p, 1] + T[2, 2] * points[p, 2]
            lowest = min(lowest, up)
        least = lowest + table.lift
        total, along_x, along_y, turn = 0.0, 0.0, 0.0, 0.0
        for p in range(n):
            a, b, c = points[p, 0], points[p, 1], points[p, 2]
            # about the object's origin
            rx = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c
            ry = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c
            rz = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c
            up = max(rz, least) + T[2, 3]
            d, gx, gy = _voxel_mean(table, rx + T[0, 3], ry + T[1, 3], up)
            total += d
            if slopes:
                along_x += gx
                along_y += gy
                turn += gy * rx - gx * ry
        if n > 0:
            means[t] = total / n
            gradients[t, 0] = along_x / n
            gradients[t, 1] = along_y / n
            gradients[t, 2] = turn / n
    return means, gradients
