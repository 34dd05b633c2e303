"""B_o, the points that fill the object: what clearance is the mean over."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.body.convex_part import ConvexPart
from placement_planner_ros.core.body.mesh import volumes_under
from placement_planner_ros.core.body.mesh_cells import surface_points
from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array

UNION_CELLS = 2_000_000
"""Cells by which it is found what pieces share: 0.8 mm for a mug, whose walls are too thin for
those of B_o."""


def volume_points(
    solids: Array, sheets: Array, hull: ConvexPart, settings: BodySettings, warnings: list[str]
) -> Array:
    """B_o: centres (n, 3) of voxels inside closed surfaces, and of those that sheets pass through.

    The grid is centred on the object's extents.

    Args:
        solids: (s, 3, 3) corners of the triangles of closed surfaces.
        sheets: (t, 3, 3) of open ones.
    """
    lower, upper = hull.vertices.min(axis=0), hull.vertices.max(axis=0)
    size = settings.voxel_size
    room = float(np.prod(upper - lower)) / size**3
    if room > 200.0 * settings.max_volume_points:  # far too fine to count first
        size *= (room / (200.0 * settings.max_volume_points)) ** (1.0 / 3.0)
    points = _voxel_centers(solids, sheets, lower, upper, size)
    while len(points) > settings.max_volume_points:
        size *= max(1.02, (len(points) / settings.max_volume_points) ** (1.0 / 3.0))
        points = _voxel_centers(solids, sheets, lower, upper, size)
    for _ in range(3):  # walls thinner than a voxel
        if len(points) >= 20:
            break
        size *= 0.5
        points = _voxel_centers(solids, sheets, lower, upper, size)
    if len(points) == 0:
        warnings.append("its walls are too thin for volume points: those of the hull stand in")
        corners = np.asarray(hull.vertices[hull.triangles])
        points = _voxel_centers(corners, sheets, lower, upper, size)
    if len(points) == 0:
        raise ObjectError("object", "thin mesh", "holds no volume point; give it a thickness")
    return points


def center_of_union(solids: Array, hull: ConvexPart) -> Array:
    """(3,) the centre of what closed surfaces (s, 3, 3) enclose, what they share counted once.

    The tetrahedra of the triangles tell the centre where nothing is shared, exactly; cells tell
    only what is enclosed more than once, as walls may be thinner than they are.
    """
    lower, upper = hull.vertices.min(axis=0), hull.vertices.max(axis=0)
    size = float((np.prod(upper - lower) / UNION_CELLS) ** (1.0 / 3.0))
    cells = _cells_inside(solids, *_centred_grid(lower, upper, size), size)
    points, more = cells[:, :3], 1.0 - cells[:, 3]
    if not len(points):
        return np.asarray(hull.vertices.mean(axis=0))
    middle = points.mean(axis=0)
    around = solids - middle
    of_each = volumes_under(around)
    volume = float(of_each.sum() + size**3 * more.sum())
    counted = size**3 * len(points)
    if not 0.5 * counted < volume < 2.0 * counted:  # surfaces that do not agree what is inside
        return np.asarray(middle)
    moment = of_each @ around.sum(axis=1) / 4.0 + size**3 * (more @ (points - middle))
    return np.asarray(middle + moment / volume)


def _voxel_centers(solids: Array, sheets: Array, lower: Array, upper: Array, size: float) -> Array:
    start, count = _centred_grid(lower, upper, size)
    points = _cells_inside(solids, start, count, size)[:, :3]
    if not len(sheets):
        return points.copy()
    filled = np.zeros(count, np.bool_)
    for on in (points, *surface_points(sheets, 0.5 * size)):
        filled[tuple(np.rint((on - start) / size).astype(np.int64).clip(0, count - 1).T)] = True
    return np.asarray(start + np.argwhere(filled) * size)


def _centred_grid(lower: Array, upper: Array, size: float) -> tuple[Array, npt.NDArray[np.int64]]:
    """Its first point (3,), and how many there are along each axis."""
    count = np.maximum(np.ceil((upper - lower) / size - 1e-9).astype(np.int64), 1)
    return 0.5 * (lower + upper) - 0.5 * (count - 1) * size, count


def _cells_inside(solids: Array, start: Array, count: npt.NDArray[np.int64], size: float) -> Array:
    """(n, 4) grid points that closed surfaces (s, 3, 3) enclose, and how often."""
    return np.asarray(_winding_cells(np.ascontiguousarray(solids), start, count, size))


@njit(cache=True, nogil=True)
def _winding_cells(
    triangles: Array, start: Array, count: npt.NDArray[np.int64], size: float
) -> Array:
    """(n, 4) grid points with a winding number other than 0, and that number, by the crossings of
    lines along z."""
    nx, ny, nz = count[0], count[1], count[2]
    winding = np.zeros((nx, ny, nz + 1), np.int32)  # differences along z
    # the lines pass a little beside the centres, off edges that meet there
    x0 = start[0] + 1.3e-7
    y0 = start[1] + 2.9e-7
    for t in range(len(triangles)):
        ax, ay, az = triangles[t, 0]
        bx, by, bz = triangles[t, 1]
        cx, cy, cz = triangles[t, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        i0 = max(math.ceil((min(ax, bx, cx) - x0) / size), 0)
        i1 = min(math.floor((max(ax, bx, cx) - x0) / size), nx - 1)
        j0 = max(math.ceil((min(ay, by, cy) - y0) / size), 0)
        j1 = min(math.floor((max(ay, by, cy) - y0) / size), ny - 1)
        for i in range(i0, i1 + 1):
            x = x0 + i * size
            for j in range(j0, j1 + 1):
                y = y0 + j * size
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                z = u * az + v * bz + w * cz
                # points above z have crossed this triangle from outside if it faces down
                k = min(max(math.ceil((z - start[2]) / size), 0), nz)
                winding[i, j, k] += 1 if area < 0.0 else -1
    points = np.empty((nx * ny * nz, 4))
    n = 0
    for i in range(nx):
        for j in range(ny):
            crossed = 0
            for k in range(nz):
                crossed += winding[i, j, k]
                if crossed != 0:
                    points[n, 0] = start[0] + i * size
                    points[n, 1] = start[1] + j * size
                    points[n, 2] = start[2] + k * size
                    points[n, 3] = crossed
                    n += 1
    return points[:n].copy()
