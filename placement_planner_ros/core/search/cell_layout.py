"""Cells of the pose sets Ŝ(r, f), as rows of an array: a face, a box of contact points, angles."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.types import Array

FACE, Z, X, Y, ANGLE, SLOPE = 0, 1, 2, 4, 6, 8
CELL_COLUMNS = 10
"""Face, z, x min and max, y min and max, θ min and max, slope along x and y; z is that of the
region's plane at x = y = 0."""
LOWER, UPPER = [X, Y, ANGLE], [X + 1, Y + 1, ANGLE + 1]
_PARTS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
PARTS = len(_PARTS)


def halved_cells(cells: Array) -> Array:
    """(8 n, 10) the parts of (n, 10) cells, cell by cell: halves of x, y and θ."""
    # Both halves of each side, in all combinations.
    low = cells[:, LOWER]
    half = (0.5 * (cells[:, UPPER] - low))[:, None]
    parts = np.repeat(cells, PARTS, axis=0).reshape(-1, PARTS, CELL_COLUMNS)
    parts[..., LOWER] = low[:, None] + _PARTS * half
    parts[..., UPPER] = low[:, None] + (_PARTS + 1) * half
    return parts.reshape(-1, CELL_COLUMNS)


def contact_areas(cells: Array) -> Array:
    """(n,) m² of the boxes of contact points."""
    return np.asarray((cells[:, X + 1] - cells[:, X]) * (cells[:, Y + 1] - cells[:, Y]))


def contact_points(cells: Array, xy: Array) -> Array:
    """(n, 3) points at (n, 2) on the planes of cells (n, 10)."""
    rise = (cells[:, [SLOPE, SLOPE + 1]] * xy).sum(axis=1)
    return np.column_stack([xy, cells[:, Z] + rise])


def region_extent(region: Region) -> tuple[float, float, float, float]:
    """x and y of a whole region, minimum and maximum each."""
    x0, y0 = region.rectangles[:, :2].min(axis=0)
    x1, y1 = region.rectangles[:, 2:].max(axis=0)
    return float(x0), float(x1), float(y0), float(y1)


def whole_cells(hierarchy: AfrHierarchy) -> Array:
    """(n, 10) cells that hold all of the pose sets, region by region."""
    cells = [
        (face, region.z, *region_extent(region), low, high, *region.slope)
        for region in hierarchy.regions
        for face in hierarchy.usable
        for of, low, high in hierarchy.pose_sets[face]
        if of is region
    ]
    return np.array(cells, dtype=np.float64).reshape(-1, CELL_COLUMNS)
