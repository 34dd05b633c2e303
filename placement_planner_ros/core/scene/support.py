"""s(x): what may stand where, judged by the points that were measured at the end of a surface.

Where a surface goes on in all eight columns around one, that column carries whatever stands on it.
In the others, at the end of the surface, a point is supported where measured points surround it:
where it lies in the hull of those within a short way of it (`SupportMap.radius`). So an edge is
never taken for further out than it was measured, however it runs through the cells. A place within
a disc without points that is wider than the points leave anyway is in a gap (`support_holes`), and
so is one through whose middle something was seen below (`support_sights`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.height_noise import height_noise
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.scene.support_bars import (
    gaps_of_bars,
    nothing_below,
    points_below,
)
from placement_planner_ros.core.scene.support_columns import (
    DEEP,
    Columns,
    kinds,
    points_on,
    radii,
)
from placement_planner_ros.core.scene.support_ends import end_within, find_ends, keeps, leave_out
from placement_planner_ros.core.scene.support_holes import (
    PARTS,
    around_holes,
    by_surface,
    empty_discs,
    parts_in_holes,
)
from placement_planner_ros.core.scene.support_meshes import gaps_of_meshes
from placement_planner_ros.core.scene.support_points import on_surface
from placement_planner_ros.core.scene.support_sights import seen_through
from placement_planner_ros.core.scene.support_spacing import narrowest_gaps
from placement_planner_ros.core.scene.surfaces import LevelSurfaces
from placement_planner_ros.core.scene.visibility import View
from placement_planner_ros.core.types import LEVEL, Array, Slope, frozen_array

_NOISY = 1.3
"""Times as wide must gaps be in noisy clouds: those of cameras have holes of their own."""
_UNASKED = np.zeros(0, np.bool_)
"""For `ends` where nothing is to be kept from them."""


@dataclass(frozen=True, eq=False)
class SupportMap:
    """Every surface of one slope of the obstacle set, in V or not: what a face may rest on.

    Heights are those above a plane of that slope through the origin: `above`.

    Attributes:
        origin, cell_size, columns: of the grid; how many columns of cells along x and y.
        start: (nx * ny + 1,) first surface of each column of the grid, and their number.
        cells: (s, 3) of the grid.
        height: (s,) z of each surface.
        rectangle: (s, 4) xmin, ymin, xmax, ymax.
        kind: (s,) whether the surface ends in its column or beside it, see above.
        radius: (s,) m, how far apart the points may be that surround what they support.
        first: (s + 1,) first of each surface's points, and their number.
        points: (k, 2) x and y of what was measured on the surfaces.
        noise: of the points, standard deviation, m.
        trim: m, the outermost of many noisy points lies beyond the true edge by about so much.
        step: heights of one surface differ by no more from one column to the next, m.
        alone: (s,) m, what lies further than that from all points of a surface that ends is a gap.
        first_hole: (s + 1,) first of the gaps that reach into each surface's column, their number.
        holes: (h, 3) x, y and radius of discs that are gaps, see `support_holes`.
        obstacles: what stands around, sheared by the slope.
        slope: of the surfaces.
    """

    origin: Array
    cell_size: float
    columns: tuple[int, int]
    start: npt.NDArray[np.int64]
    cells: npt.NDArray[np.int32]
    height: Array
    rectangle: Array
    kind: npt.NDArray[np.uint8]
    radius: Array
    first: npt.NDArray[np.int64]
    points: npt.NDArray[np.float32]
    noise: float
    trim: float
    step: float
    alone: Array
    first_hole: npt.NDArray[np.int64]
    holes: Array
    obstacles: ObstacleArrays
    slope: Slope = LEVEL

    @classmethod
    def of(
        cls,
        obstacles: ObstacleSet,
        surfaces: LevelSurfaces,
        slope: Slope,
        asked: npt.NDArray[np.bool_],
        sights: Sequence[View] = (),
    ) -> SupportMap:
        """Of the level surfaces of an obstacle set that was sheared by a slope.

        Args:
            asked: (s,) which surfaces' gaps count; nothing is to be placed at the others' heights.
            sights: what sensors at known places measured, not sheared: what they saw below a
                surface proves gaps in it.
        """
        nx, ny, _ = obstacles.shape
        tolerance = obstacles.surface_tolerance + 0.5 * obstacles.noise
        step = 2.0 * tolerance
        cells, start, height = surfaces.cells, surfaces.start, surfaces.height
        measured = obstacles.surface_points, obstacles.surface_first
        size = obstacles.cell_size
        first, points, filled = points_on(obstacles.arrays, *measured, cells, height, step)
        radius = radii(cells, start, height, first, nx, ny, size, step)
        none = np.zeros(len(height) + 1, np.int64)

        def kind(holed: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint8]:
            return np.asarray(
                kinds(cells, start, height, filled, holed, radius, nx, ny, size, step)
            )

        closed = cls(
            obstacles.origin,
            size,
            (nx, ny),
            start,
            cells,
            frozen_array(height),
            surfaces.rectangle,
            kind(none[1:] > 0),
            radius,
            first,
            points,
            obstacles.noise,
            2.0 * obstacles.noise,
            step,
            np.full(len(height), np.inf),
            none,
            np.zeros((0, 3)),
            obstacles.arrays,
            slope,
        )
        view = closed._view
        narrowest, beside = narrowest_gaps(view, cells, asked)
        narrowest *= _NOISY if obstacles.noise > 0.0 else 1.0
        narrowest = np.minimum(narrowest, gaps_of_meshes(view, cells, beside))
        of_all = obstacles.points, obstacles.first_point
        clean = asked & (obstacles.noise == 0.0)  # noise is below and beside a surface, too
        below = points_below(view, clean, obstacles.arrays, *of_all)
        bars = gaps_of_bars(view, cells, clean, below)
        bars[bars >= narrowest] = np.inf
        of_bars = empty_discs(view, obstacles.arrays, cells, bars)
        discs = np.vstack(
            [
                empty_discs(view, obstacles.arrays, cells, narrowest),
                of_bars[nothing_below(view, below, of_bars)],
                seen_through(view, asked, sights, slope, obstacles.noise),
            ]
        )
        first_hole, holes = by_surface(view, discs)
        holed = np.diff(first_hole) > 0
        return replace(
            closed, kind=kind(holed), alone=narrowest, first_hole=first_hole, holes=holes
        )

    @cached_property
    def ends(self) -> npt.NDArray[np.bool_]:
        """(k,) beyond which of the points a surface that ends drops, or was not seen.

        Asked for where more than a cell is to be kept from them, or they are weighed.
        """
        return np.asarray(find_ends(self._view, self.obstacles, self.step))

    @cached_property
    def height_noise(self) -> float:
        """m by which noise makes heights of one surface differ."""
        return height_noise(self.columns, self.start, self.height, self.noise)

    @cached_property
    def _view(self) -> Columns:
        return Columns(
            self.origin,
            self.cell_size,
            *self.columns,
            self.start,
            self.height,
            self.kind,
            self.radius,
            self.first,
            self.points,
            self.step,
            self.alone,
            self.first_hole,
            self.holes,
        )

    @property
    def holed(self) -> npt.NDArray[np.int64]:
        """(k,) surfaces with gaps."""
        return np.flatnonzero(np.diff(self.first_hole))

    @cached_property
    def parts_in_holes(self) -> npt.NDArray[np.bool_]:
        """(k, 8, 8) which parts of the columns of `holed` surfaces surely carry nothing, by x, y.

        They are all the parts of a column that are gaps but for the ones that a gap ends in.
        """
        return np.asarray(parts_in_holes(self._view, self.cells, self.holed))

    def whole_parts(self) -> tuple[Array, npt.NDArray[np.int64]]:
        """(n, 4) disjoint rectangles of all surfaces without their gaps; (n,) of which each is."""
        holed = self.holed
        rows = np.arange(len(self.height))
        if not len(holed):
            return self.rectangle, rows
        lower = self.origin[:2] + self.cells[holed, :2] * self.cell_size
        edge = self.cell_size / PARTS
        found, of = around_holes(self.rectangle[holed], lower, edge, self.parts_in_holes)
        solid = np.delete(rows, holed)
        order = np.argsort(row := np.concatenate([solid, holed[of]]), kind="stable")
        return np.concatenate([self.rectangle[solid], found])[order], row[order]

    def above(self, points: Array) -> Array:
        """(n, 3) points with their height above the plane through the origin as z, metres."""
        if self.slope == LEVEL:
            return points
        result = points.copy()
        result[:, 2] -= points[:, :2] @ np.array(self.slope)
        return result

    def supported(
        self, points: Array, tolerance: float, margin: float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """s(x) for each point: is there surface under it, within `tolerance` of its height?

        `gaps` says how far above each point that surface is, too.

        Args:
            points: (n, 3), metres.
            tolerance: metres, above or below.
            margin: metres to be kept from where the surface drops or was not seen. Where a thing
                stands in the way there, nothing is to be kept from.

        Returns:
            (n,)
        """
        return np.isfinite(self.gaps(points, tolerance, margin))

    def gaps(
        self,
        points: Array,
        tolerance: float,
        margin: float | None = 0.0,
        first: npt.NDArray[np.int64] | None = None,
    ) -> Array:
        """(n,) m that surface is above each point; NaN where `supported` does not hold.

        Args:
            margin: None for surfaces as they were measured, up to `trim` beyond their true ends.
            first: (m + 1,) where groups of points begin, and n. Of a group of which one point is
                not supported, others may be NaN, too. Each point is one unless given.
        """
        beside = 0.0 if margin is None else margin + self.trim
        return np.asarray(
            _gaps(
                np.ascontiguousarray(self.above(points), dtype=np.float64),
                np.arange(len(points) + 1) if first is None else first,
                tolerance,
                beside,
                self._view,
                self.ends if beside > self.cell_size else _UNASKED,
                self.obstacles,
            )
        )

    def roomy(
        self, z: float, tolerance: float, margin: float | None, off: float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """(s,) the surfaces on some point of which something may stand at height z.

        Args:
            z: metres, above the plane through the origin.
            tolerance, margin: metres; as for `gaps`.
            off: at any height that differs from z by no more, metres.
        """
        near = np.asarray(np.abs(self.height - z) <= tolerance + off)
        near[self.holed[self.parts_in_holes.all(axis=(1, 2))]] = False
        if margin is not None and margin + self.trim > self.cell_size:
            surely = np.asarray(np.abs(self.height - z) <= tolerance - off)
            leave_out(self._view, self.ends, surely, margin + self.trim, near)
        return near


@kernel(nogil=True)
def _gaps(
    points: Array,
    first: npt.NDArray[np.int64],
    tolerance: float,
    margin: float,
    columns: Columns,
    ends: npt.NDArray[np.bool_],
    boxes: ObstacleArrays,
) -> Array:
    """`SupportMap.gaps`."""
    result = np.full(len(points), np.nan)
    surface = np.full(len(points), -1)
    beside = min(margin, columns.cell_size)
    for group in range(len(first) - 1):
        begin, end = first[group], first[group + 1]
        # To ask for the margin takes far longer than whether there is surface.
        carried = True
        for p in range(begin, end):
            surface[p] = on_surface(columns, points[p, 0], points[p, 1], points[p, 2], tolerance)
            if surface[p] < 0:
                carried = False
                break
        if not carried:
            continue
        for p in range(begin, end):
            x, y, z, s = points[p, 0], points[p, 1], points[p, 2], surface[p]
            if margin > 0.0:
                kind = columns.kind[s]
                if kind != DEEP and not keeps(columns, boxes, s, x, y, z, tolerance, beside):
                    break
                if margin > columns.cell_size and end_within(
                    columns, ends, x, y, z, tolerance, margin
                ):
                    break
            result[p] = columns.height[s] - z
    return result
