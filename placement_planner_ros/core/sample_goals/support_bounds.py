"""Cells of Ŝ(r, f) that provably leave the object without support, or beside V.

Tables of sums tell in constant time whether a rectangle holds a column of the support map with a
surface at the contact height.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.contacts.by_polygon import PolygonSupport
from placement_planner_ros.core.sample_goals.placed_cells import PlacedCells
from placement_planner_ros.core.scene.support import SupportMap
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.core.weak_cache import weak_lru_cache

Mask = npt.NDArray[np.bool_]
Index = npt.NDArray[np.int64]

_ROUNDING_M = 1e-6
"""m, more than arithmetic is off by, and than surfaces reach beyond their edges."""
_SAME_HEIGHT_M = 1e-3
"""m: surfaces for contact heights closer together than this are looked up in one table."""


class SupportBound:
    """Whether what carries the object may be there, and the centre of mass in V.

    Args:
        poses: s(x), of one problem.
    """

    def __init__(self, poses: PoseConstraints) -> None:
        body = poses.problem.body
        self._volume = poses.problem.volume
        self._centers = np.array([f.T_face_object.act(body.center_of_mass) for f in body.faces])
        self._centers = self._centers.reshape(-1, 1, 3)
        if isinstance(poses.faces.support, PolygonSupport):
            self._rule: _Rule = _Polygon(poses.faces.support, _Columns(poses, None))
        else:
            self._rule = _Vertices(poses, _Columns(poses, poses.footing.edge_margin))

    def unsupported(self, placed: PlacedCells) -> Mask:
        """(n,) cells at all of whose poses support is lacking, or the centre of mass beside V."""
        centers = self._centers[placed.face]
        middle = placed.middles(centers)[:, 0, :2]
        within = placed.half + placed.strays(centers) + _ROUNDING_M
        heights = placed.contact[:, 2], placed.rise + _ROUNDING_M
        outside = _beside_volume(self._volume, middle, within, *heights)
        return np.asarray(self._rule.lacks(placed) | outside)


class _Rule(Protocol):
    def lacks(self, placed: PlacedCells) -> Mask:
        """(n,) cells at all of whose poses s(x) does not hold."""
        ...


class _Vertices:
    """Every vertex of v(f) may find a surface in the rectangle that it stays in."""

    def __init__(self, poses: PoseConstraints, columns: _Columns) -> None:
        self._columns = columns
        # The corners of each face about the contact point.
        feet = []
        for face in poses.problem.body.faces:
            T = face.T_face_object
            feet.append((face.vertices @ T.rotation.T + T.translation)[:, :2])
        most = max((len(points) for points in feet), default=0)
        # padded with the first vertex, so that all faces have as many; on the plane, z is 0
        self._contacts = np.zeros((len(feet), most, 3))
        for padded, points in zip(self._contacts, feet, strict=True):
            padded[: len(points), :2] = points
            padded[len(points) :, :2] = points[0]

    def lacks(self, placed: PlacedCells) -> Mask:
        feet = self._contacts[placed.face]
        middles = placed.middles(feet)[..., :2]
        within = placed.half[:, None] + placed.strays(feet)[..., None] + _ROUNDING_M
        found = self._columns.within(placed, middles - within, middles + within)
        return np.asarray((found == 0).any(axis=1))


class _Polygon:
    """There may be surface ahead, behind, left and right of the centre of mass, as far from it as
    the hull of what carries must reach, and no farther from its foot than the body touches."""

    def __init__(self, support: PolygonSupport, columns: _Columns) -> None:
        self._support = support
        self._columns = columns

    def lacks(self, placed: PlacedCells) -> Mask:
        # Squares that must hold support: to each side of the centre of mass.
        shift, inside = self._support.least_inside(placed.face, placed.slope)
        radius = self._support.radii[placed.face, None] + _ROUNDING_M
        foot = placed.contact[:, :2]
        low, high = foot - placed.half, foot + placed.half
        lowest, highest = (
            np.stack([low - radius] * 4, axis=1),
            np.stack([high + radius] * 4, axis=1),
        )
        keeps = inside[:, None] - _ROUNDING_M
        for axis in range(2):
            lowest[:, 2 * axis, axis] = (low + shift + keeps)[:, axis]
            highest[:, 2 * axis + 1, axis] = (high + shift - keeps)[:, axis]
        # Some of them holds none.
        found = self._columns.within(placed, lowest, highest)
        return np.asarray((found == 0).any(axis=1))


class _Columns:
    """Columns in which there is room for a margin, see `SupportMap.room`.

    Only those that a body standing in V can reach, at the heights of the regions.
    """

    def __init__(self, poses: PoseConstraints, margin: float | None) -> None:
        body, environment = poses.problem.body, poses.problem.environment
        volume, measured = poses.problem.volume, environment.measured
        size = float(np.linalg.norm(np.ptp(body.vertices, axis=0)))
        self._cell_size = measured.cell_size
        # columns are the same for every body
        self._first = np.floor((volume.lower[:2] - size) / self._cell_size).astype(np.int64)
        self._origin = self._first * self._cell_size
        self._shape = self._columns_of(volume.upper[:2] + size) + 1
        self._tables = {}
        # A table for each slope of a region.
        for slope in {region.slope for region in poses.faces.regions}:
            heights = np.array([r.z for r in poses.faces.regions if r.slope == slope])
            levels = np.unique(np.round(heights / _SAME_HEIGHT_M))
            tolerance = poses.footing.contact_tolerance
            of_levels = [
                np.unique(heights[np.round(heights / _SAME_HEIGHT_M) == z]) for z in levels
            ]
            sums = self._summed(environment.support_of(slope), of_levels, tolerance, margin)
            self._tables[slope] = levels, sums

    def _summed(
        self,
        support: SupportMap,
        levels: list[Array],
        tolerance: float,
        margin: float | None,
    ) -> Array:
        """(levels, nx + 1, ny + 1) columns with room at the heights of each level, summed up."""
        nx, ny = self._shape
        sums = np.zeros((len(levels), nx + 1, ny + 1), dtype=np.int32)
        # Mark columns with a surface at these heights, and sum them up.
        for table, heights in zip(sums, levels, strict=True):
            for z in heights.tolist():
                columns = _with_room(support, z, tolerance, margin, self._cell_size) - self._first
                near = ((columns >= 0) & (columns < (nx, ny))).all(axis=1)
                table[columns[near, 0] + 1, columns[near, 1] + 1] = 1
        return np.asarray(sums.cumsum(axis=1, dtype=np.int32).cumsum(axis=2, dtype=np.int32))

    def _columns_of(self, points: Array) -> Index:
        return np.floor((points - self._origin) / self._cell_size).astype(np.int64)

    def within(self, placed: PlacedCells, lowest: Array, highest: Array) -> Index:
        """(n, m) how many there are at the height of each cell from corners to corners (n, m, 2);
        none where the first lie beyond the second."""
        # Columns of both corners, within the table.
        low = np.floor((lowest - self._origin) / self._cell_size).astype(np.int64)
        high = np.floor((highest - self._origin) / self._cell_size).astype(np.int64) + 1
        low, high = np.clip(low, 0, self._shape), np.clip(high, 0, self._shape)
        high = np.maximum(low, high)
        i0, j0, i1, j1 = low[..., 0], low[..., 1], high[..., 0], high[..., 1]
        found = np.zeros(i0.shape, dtype=np.int64)
        # The number in a rectangle, by four sums.
        for slope, (levels, sums) in self._tables.items():
            of = (placed.slope == slope).all(axis=1)
            level = np.searchsorted(levels, np.round(placed.height[of] / _SAME_HEIGHT_M))[:, None]
            a, b, c, d = i0[of], j0[of], i1[of], j1[of]
            found[of] = sums[level, c, d] - sums[level, a, d] - sums[level, c, b]
            found[of] += sums[level, a, b]
        return found


@weak_lru_cache("support", maxsize=64)
def _with_room(
    support: SupportMap, z: float, tolerance: float, margin: float | None, cell_size: float
) -> Index:
    """(k, 2) columns of cells with room for a margin at that height, as s(x) is asked for it."""
    squares = support.room(z, tolerance, margin, _ROUNDING_M)
    x0, y0, x1, y1 = np.floor(squares / cell_size).astype(np.int64).T
    ends = np.concatenate(
        [np.column_stack(each) for each in ((x0, y0), (x0, y1), (x1, y0), (x1, y1))]
    )
    if not len(ends):
        return ends
    low = ends.min(axis=0)
    held = np.zeros(ends.max(axis=0) - low + 1, np.bool_)
    held[tuple((ends - low).T)] = True
    return np.asarray(np.argwhere(held) + low)


def _beside_volume(
    volume: TargetVolume, middle: Array, within: Array, height: Array, rise: Array
) -> Mask:
    """(n,) whether no point within a square of half sides (n, 2), and within a rise (n,) of a
    height (n,), lies in V."""
    beside = np.ones(len(middle), np.bool_)
    # Beside or above or below every box of V.
    for lower, upper in volume.joined:
        away = (middle + within < lower[:2]) | (middle - within > upper[:2])
        apart = (height + rise < lower[2]) | (height - rise > upper[2])
        beside &= away.any(axis=1) | apart
    return beside
