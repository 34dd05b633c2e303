"""The one obstacle set: points of a cloud, as tight boxes in the cells of a grid.

A cell's box is the tight axis-aligned box around the points measured in it, so a level surface
stays level to the millimetre instead of growing by half a cell. A cell in which a surface meets
another (floor and wall) holds one box per surface. Boxes of one surface are closed over the gap to
the neighbouring cell, up to the face the two cells share; nothing grows where no neighbour is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.errors import CloudError
from placement_planner_ros.core.scene.cells import (
    Bins,
    CellBoxes,
    boxes_of_cells,
    close_gaps,
    sort_into_cells,
)
from placement_planner_ros.core.scene.cloud import checked_bounds, checked_cloud, finite_extent
from placement_planner_ros.core.scene.denoising import without_noise
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import (
    LEVEL,
    SINGLE_ROUNDING,
    Array,
    Index,
    Index32,
    Mask,
    Slope,
    frozen_array,
    kernel_input,
)

_AnyArray = TypeVar("_AnyArray", bound=npt.NDArray)

_ORIGIN_SHIFT = 0.03
"""Cells begin this share of a cell before whole multiples of their size, so that a surface at a
round height does not fall onto a face between two layers, where rounding would scatter its points
over both."""
SKIN_M = 0.0005
"""m that heights within a level surface differ by where nothing is noisy."""


@dataclass(frozen=True, slots=True)
class GridSettings(Settings):
    """How points become the obstacle set.

    Attributes:
        cell_size: about twice the spacing of the points, or more.
        noise_floor: clouds whose surfaces scatter by less than this (standard deviation) are
            clean: their points are used exactly as they are.
        min_points: where a cell and the 26 around it hold fewer points than this, these are flying
            pixels; 0 for none. Sparse clouds (median below 4 points per cell) are spared.
        max_boxes_per_cell: into how many boxes a cell may be cut where surfaces meet.
        max_cells: a grid with more cells than this is refused: 5 bytes each, of which 4 are touched
            only around what was measured.
    """

    cell_size: float = setting(0.01, "[0.002, 0.1]", "m", "Edge of the obstacle set's cells.")
    noise_floor: float = setting(0.00005, "[0, inf)", "m")
    min_points: int = setting(3, "[0, inf)")
    max_boxes_per_cell: int = setting(4, "[1, 4]")
    max_cells: int = setting(100_000_000, "[1, inf)")


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleSet:
    """The environment: m tight boxes in the cells of a grid.

    Attributes:
        origin: (3,) lower corner of the grid, metres.
        cell_size: edge of a cell, metres.
        shape: number of cells along x, y, z.
        cells: (m, 3) int32, the cell each box lies in, in lexicographic order; boxes of the same
            cell are consecutive.
        lower, upper: (m, 3) corners of the boxes.
        number_at: (nx, ny, nz) int32, one more than the number of the first box of a cell, or 0.
            Where nothing was measured it is memory that nobody has touched, which costs nothing.
        next: (m,) int32, another box of the same cell, or -1.
        first_point: (m + 1,) the first of all points of each box, and their number.
        points: (n, 3) of all boxes, box by box, as they were taken.
        noise: standard deviation of the points about their surfaces, estimated, metres.
        barred: (m,) boxes that nothing stands on, whatever their height; None where all may carry.
    """

    origin: Array
    cell_size: float
    shape: tuple[int, int, int]
    cells: Index32
    lower: Array
    upper: Array
    number_at: Index32
    next: Index32
    first_point: Index
    points: npt.NDArray[np.float32]
    noise: float
    barred: Mask | None = None

    def __len__(self) -> int:
        return len(self.cells)

    @property
    def arrays(self) -> ObstacleArrays:
        """For kernels."""
        return ObstacleArrays(
            self.origin,
            self.cell_size,
            self.cells,
            self.lower,
            self.upper,
            self.number_at,
            self.next,
        )

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper corner (3,) of the grid, metres."""
        return self.origin, self.origin + self.cell_size * np.array(self.shape)

    @property
    def surface_tolerance(self) -> float:
        """How far points of one level surface may differ in height after de-noising, metres."""
        return surface_tolerance(self.noise)

    @classmethod
    def from_points(
        cls,
        points: npt.ArrayLike,
        settings: GridSettings | None = None,
        bounds: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    ) -> ObstacleSet:
        """Build the obstacle set from surface points in the planning frame.

        Points that are not finite or lie outside `bounds` are left out. Flying pixels are dropped.
        Points of a noisy cloud are projected onto the plane of their neighbourhood.

        Args:
            points: (n, 3), metres; NaN where nothing was seen.
            settings: GridSettings() unless given.
            bounds: lower and upper corner of the workspace; around the points unless given.

        Raises:
            CloudError: not (n, 3), no finite point among those given, no points and no bounds, or
                a grid of more than `max_cells`.
        """
        settings, cloud = settings or GridSettings(), checked_cloud(points)
        if bounds is not None:
            return cls.of_cloud(cloud, settings, *checked_bounds(bounds))
        count, corners = finite_extent(cloud)
        if count == 0:
            raise CloudError("points", "0 points", "give points, or the bounds of the workspace")
        return cls.of_cloud(cloud, settings, corners[0], corners[1])

    @classmethod
    def of_cloud(
        cls,
        cloud: Array,
        settings: GridSettings,
        lower: Array,
        upper: Array,
        noise: float | None = None,
    ) -> ObstacleSet:
        """`from_points` of what has been checked.

        Args:
            noise: of points that lie on their surfaces already; estimated, and removed, unless
                given.
        """
        # The corner of the cell that the lower end lies in: cells are the same in every grid.
        size = settings.cell_size
        origin = (np.floor(lower / size + _ORIGIN_SHIFT) - _ORIGIN_SHIFT) * size
        shape = _grid_shape(origin, upper, settings)

        bounds = kernel_input(lower), kernel_input(upper)

        def sort(points: Array, number_at: Index32) -> Bins:
            found = sort_into_cells(kernel_input(points), origin, size, *bounds, number_at)
            return Bins(*found, number_at)

        bins = sort(cloud, np.zeros(shape, np.int32))
        if noise is None and len(bins.cells):
            step("telling noise from surfaces")
            clean, noise = without_noise(
                bins, origin, size, settings.noise_floor, settings.min_points, (lower, upper)
            )
            if clean is not None:
                bins.number_at[tuple(bins.cells.T)] = 0  # less is touched than in another array
                bins = sort(clean, bins.number_at)
        step("making boxes of cells")
        noise = noise or 0.0
        skin = surface_tolerance(noise)
        boxes = CellBoxes(*boxes_of_cells(bins, skin, settings.max_boxes_per_cell))
        low, high = close_gaps(boxes, bins.number_at, origin, size, skin)
        return cls(
            origin=frozen_array(origin, (3,)),
            cell_size=size,
            shape=shape,
            cells=_read_only(boxes.cells),
            lower=_read_only(low),
            upper=_read_only(high),
            number_at=_read_only(bins.number_at),
            next=_read_only(boxes.next),
            first_point=_read_only(boxes.first_point),
            points=_read_only(boxes.points),
            noise=noise,
        )

    def without_footing(self, cells: npt.NDArray[np.integer] | Array) -> ObstacleSet:
        """The same, but nothing stands on the boxes in those cells (k, 3), wherever they are."""
        sizes = np.array(self.shape)
        inside = cells[((cells >= 0) & (cells < sizes)).all(axis=1)].astype(np.int64)
        keys = [
            (c[:, 0] * sizes[1] + c[:, 1]) * sizes[2] + c[:, 2]
            for c in (self.cells.astype(np.int64), inside)
        ]
        old = np.zeros(len(self), np.bool_) if self.barred is None else self.barred
        return replace(self, barred=_read_only(old | np.isin(keys[0], keys[1])))

    def tops(self, slope: Slope = LEVEL) -> Array:
        """(m,) how high each box reaches in z - slope · (x, y), metres; infinite where nothing
        stands on it."""
        top = self.upper[:, 2].copy()
        if self.barred is not None:
            top[self.barred] = np.inf
        if slope == LEVEL or not len(top):
            return top
        # the highest corner of each box, seen along the slope
        falls = -np.array(slope)
        result = top + np.maximum(self.lower[:, :2] * falls, self.upper[:, :2] * falls).sum(axis=1)
        rows = np.flatnonzero(np.diff(self.first_point))  # in the others nothing was measured
        if len(rows):
            z = self.points[:, 2].astype(np.float64)
            along = z - self.points[:, :2].astype(np.float64) @ np.array(slope)
            first = self.first_point[rows]
            reach = np.maximum.reduceat(along, first) - np.maximum.reduceat(z, first)
            result[rows] = top[rows] + reach
        return result

    def with_full_cells(self, cells: Index32, below: float = 0.0) -> ObstacleSet:
        """A copy in which further cells, until now empty, are obstacles as a whole.

        Nothing was measured in them, so no surface lies on them: take regions and support from the
        set without them.

        Args:
            cells: (k, 3) distinct empty cells.
            below: metres that a cell stays below what was measured in the cell above it, where
                that covers all of it. What keeps half as much from both does not fit between.
        """
        lower = self.origin + cells * self.cell_size
        upper = lower + self.cell_size
        covered = self._covered_from(cells, lower, upper)
        upper[:, 2] = np.maximum(np.minimum(upper[:, 2], covered - below), lower[:, 2])
        barred = None if self.barred is None else np.append(self.barred, np.zeros(len(cells), bool))
        return self._with(cells, lower, upper, barred)

    def _covered_from(self, cells: Index32, lower: Array, upper: Array) -> Array:
        """(k,) height of the lowest box that covers each cell in the cell above it; inf without."""
        above = cells + np.array([0, 0, 1], dtype=np.int32)
        heights = np.full(len(cells), np.inf)
        known = np.flatnonzero(above[:, 2] < self.shape[2])
        rows = self.number_at[tuple(above[known].T)] - 1
        while (rows >= 0).any():
            # box after box of the cell above, until none is left
            known, rows = known[rows >= 0], rows[rows >= 0]
            covers = (self.lower[rows, :2] <= lower[known, :2] + SINGLE_ROUNDING).all(axis=1)
            covers &= (self.upper[rows, :2] >= upper[known, :2] - SINGLE_ROUNDING).all(axis=1)
            found, low = known[covers], self.lower[rows[covers], 2]
            heights[found] = np.minimum(heights[found], low)
            rows = self.next[rows]
        return heights

    def with_boxes(self, cells: Index32, lower: Array, upper: Array) -> ObstacleSet:
        """A copy with further boxes, of corners (k, 3), that nothing stands on.

        Args:
            cells: (k, 3) that they lie in, empty or not.
        """
        old = np.zeros(len(self), np.bool_) if self.barred is None else self.barred
        return self._with(cells, lower, upper, np.concatenate([old, np.ones(len(cells), np.bool_)]))

    def reaching(self, lower: Array, upper: Array) -> ObstacleSet:
        """The same in a grid that holds corners (3,) too; its cells stay where they are.

        Raises:
            CloudError: it has more cells than `max_cells`.
        """
        size, (low, high) = self.cell_size, self.bounds
        # whole cells to be added before and after
        before = np.maximum(np.ceil((low - lower) / size), 0.0).astype(np.int64)
        after = np.maximum(np.ceil((upper - high) / size), 0.0).astype(np.int64)
        if not (before.any() or after.any()):
            return self
        origin = low - before * size
        _grid_shape(origin, high + after * size, GridSettings(cell_size=size))
        number_at = np.zeros(np.array(self.shape) + before + after, np.int32)
        cells = self.cells + before.astype(np.int32)
        number_at[tuple(cells.T)] = self.number_at[tuple(self.cells.T)]
        return replace(
            self,
            origin=frozen_array(origin),
            shape=number_at.shape,
            cells=_read_only(cells),
            number_at=_read_only(number_at),
        )

    def _with(self, cells: Index32, lower: Array, upper: Array, barred: Mask | None) -> ObstacleSet:
        """A copy with further boxes in those cells (k, 3)."""
        together = np.vstack([self.cells, cells]).astype(np.int32)
        order = np.lexsort(together.T[::-1])  # stable: boxes of one cell stay next to each other
        number_at = np.zeros(self.shape, np.int32)
        ordered = together[order]
        held = np.concatenate([np.diff(self.first_point), np.zeros(len(cells), np.int64)])
        # the first box of each cell, and the next of each box
        first = np.ones(len(order), np.bool_)
        first[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
        following = np.arange(1, len(order) + 1, dtype=np.int32)
        following[np.append(first[1:], True)] = -1
        number_at[tuple(ordered[first].T)] = np.flatnonzero(first) + 1
        return replace(
            self,
            cells=_read_only(ordered),
            lower=_read_only(np.vstack([self.lower, lower])[order]),
            upper=_read_only(np.vstack([self.upper, upper])[order]),
            number_at=_read_only(number_at),
            next=_read_only(following),
            first_point=_read_only(np.concatenate([[0], held[order].cumsum()])),
            barred=None if barred is None else _read_only(barred[order]),
        )


def surface_tolerance(noise: float) -> float:
    """Height differences within one level surface, metres: a skin, four of them in much noise."""
    return float(np.clip(0.5 * noise, SKIN_M, 2.0 * 2.0 * SKIN_M))


def _read_only(array: _AnyArray) -> _AnyArray:
    array.setflags(write=False)
    return array


def _grid_shape(origin: Array, upper: Array, settings: GridSettings) -> tuple[int, int, int]:
    sides = np.floor((upper - origin) / settings.cell_size) + 1.0
    if not np.isfinite(sides).all() or sides.prod() > settings.max_cells:
        shown = " x ".join(f"{side * settings.cell_size:.4g}" for side in sides)
        raise CloudError(
            "`cell_size`",
            settings.cell_size,
            f"makes more than {settings.max_cells} cells of the {shown} m that are of interest; "
            "set it higher, or a `volume` nearer to the robot",
        )
    return int(sides[0]), int(sides[1]), int(sides[2])
