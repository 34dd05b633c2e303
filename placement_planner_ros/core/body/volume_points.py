"""B_o, the points that fill the object: what clearance is the mean over."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from placement_planner_ros.core.body.convex_part import ConvexPart
from placement_planner_ros.core.body.mesh_cells import MAX_CELLS, surface_points
from placement_planner_ros.core.body.mesh_components import volumes_under
from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.types import Array, Index, Index32


def volume_points(solids: Array, sheets: Array, hull: ConvexPart, settings: BodySettings) -> Array:
    """B_o: centres (n, 3) of voxels inside closed surfaces, and of those that sheets pass through.

    Where those inside make up less than half of the volume, whose walls are thin then, those that
    its surface passes through count, too.

    Args:
        solids: (s, 3, 3) corners of the triangles of closed surfaces.
        sheets: (t, 3, 3) of open ones.
    """
    size, volume = settings.voxel_size, float(volumes_under(solids).sum())
    while True:
        # Voxels inside solids, and on sheets; on walls that are too thin for voxels, too.
        start, size, winding = winding_numbers(solids, hull, size)
        filled, last = winding != 0, np.array(winding.shape) - 1
        thin = size**3 * np.count_nonzero(filled) < 0.5 * volume
        walls = np.concatenate([solids, sheets]) if thin else sheets
        for on in surface_points(walls, 0.5 * size):
            filled[tuple(np.rint((on - start) / size).astype(np.int64).clip(0, last).T)] = True
        # Coarser, where they are too many.
        points = start + np.argwhere(filled) * size
        if len(points) <= settings.max_volume_points:
            return np.asarray(points)
        size *= max(1.02, (len(points) / settings.max_volume_points) ** (1.0 / 3.0))


def center_of_union(solids: Array, hull: ConvexPart, size: float) -> Array:
    """(3,) the centre of what closed surfaces (s, 3, 3) enclose, what they share counted once; not
    finite where that is nothing.

    The tetrahedra of the triangles tell the centre where nothing is shared, exactly; cells of that
    size, m, tell only what is enclosed more than once.
    """
    start, size, winding = winding_numbers(solids, hull, size)
    shared = np.argwhere(winding > 1)
    more = size**3 * (1.0 - winding[tuple(shared.T)])
    middle = hull.vertices.mean(axis=0)
    around, volumes = solids - middle, volumes_under(solids - middle)
    moment = volumes @ around.sum(axis=1) / 4.0 + more @ (start + shared * size - middle)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(middle + moment / (volumes.sum() + more.sum()))


def winding_numbers(solids: Array, hull: ConvexPart, size: float) -> tuple[Array, float, Index32]:
    """How often closed surfaces (s, 3, 3) go around each point of a grid over the hull.

    Its first point (3,); how far they are apart, metres: more than `size` where they would be more
    than `MAX_CELLS`; and the (nx, ny, nz) numbers.
    """
    lower, upper = hull.vertices.min(axis=0), hull.vertices.max(axis=0)
    size = max(size, float(np.prod(upper - lower) / MAX_CELLS) ** (1.0 / 3.0))
    count = np.maximum(np.ceil((upper - lower) / size - 1e-9).astype(np.int64), 1)
    start = 0.5 * (lower + upper) - 0.5 * (count - 1) * size
    changes = _winding_changes(np.ascontiguousarray(solids), start, count, size)
    return start, size, np.cumsum(changes, axis=2, dtype=np.int32)[..., :-1]


@njit(cache=True, nogil=True)
def _winding_changes(triangles: Array, start: Array, count: Index, size: float) -> Index32:
    """(nx, ny, nz + 1) how the winding number changes along z from each grid point to the one
    above, by the crossings of lines through them."""
    nx, ny, nz = count[0], count[1], count[2]
    changes = np.zeros((nx, ny, nz + 1), np.int32)
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
        # lines through the triangle's box
        i0 = max(math.ceil((min(ax, bx, cx) - x0) / size), 0)
        i1 = min(math.floor((max(ax, bx, cx) - x0) / size), nx - 1)
        j0 = max(math.ceil((min(ay, by, cy) - y0) / size), 0)
        j1 = min(math.floor((max(ay, by, cy) - y0) / size), ny - 1)
        for i in range(i0, i1 + 1):
            x = x0 + i * size
            for j in range(j0, j1 + 1):
                y = y0 + j * size
                # where the line is in the triangle, by the shares of its corners
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                # points above z have crossed this triangle from outside if it faces down
                z = u * az + v * bz + w * cz
                k = min(max(math.ceil((z - start[2]) / size), 0), nz)
                changes[i, j, k] += 1 if area < 0.0 else -1
    return changes
