"""d_S, the distance to the obstacle set that the clearance objective averages."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.scene.boxes_by_height import boxes_by_height
from placement_planner_ros.core.scene.clearance_levels import AROUND
from placement_planner_ros.core.scene.clearance_lookup import Table, distances, mean_clearance
from placement_planner_ros.core.scene.clearance_table import ClearanceTable
from placement_planner_ros.core.scene.counted_boxes import CountedBoxes, counted_boxes
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.leaning_boxes import sliced
from placement_planner_ros.core.scene.nearest_boxes import Lines
from placement_planner_ros.core.types import Array, TargetVolume

CAP = 0.5
"""m, the greatest distance that counts: what an empty table has."""
_LEVEL = 0.00125
"""m between two levels, where there is room for so many."""
MAX_VALUES = 16_000_000
"""Values that a field has at most, of 4 bytes each."""
_FLATTER = 8.0
"""Lines are at least so many times as far apart as levels before levels move apart."""
_AT_ONCE = 0.05
"""m around V in which values are made before anybody asks for them."""
_BODIES = 8
"""Sets of points whose extent is remembered."""
_ROUNDING = 1e-9
"""m."""


class ClearanceField:
    """d_S: distance sideways and upwards to obstacles in V and around it, capped.

    Nothing that ends below a point counts for it, so d_S jumps where a thing ends beside it. A
    point stands for what is around it, from half a voxel below to half a voxel above: its value is
    the mean of d_S over this height. So the clearance of a body is continuous in z too, and the
    heights at which things end count as they were measured, wherever the layers of cells lie.

    Sampled on the grid lines of the obstacle set in x and y, exact there but for less than a cell
    where several boxes that end at one height compete, and interpolated linearly between them; in
    z on levels 1.25 mm apart, with what ends between two of them counted by its share, up to where
    the last thing ends. Boxes of V that lie far from each other have a table each. Where V is so
    large that all would take more than `MAX_VALUES`, lines and levels are further apart, and `lift`
    is more. Values in and beside V are made at once, those further out when they are first asked
    for.

    What a body stands on does not count, and may rise by the contact tolerance above its lowest
    point: what of the body is lower than `lift` above that point is judged at that height.

    Attributes:
        lift: see above, metres.

    Args:
        obstacles: those of its boxes count that touch V, grown by `beyond`, up to where that ends.
        volume: V.
        beyond: how far outside V things count, metres: 0 is the paper's definition.
        cap: greatest value, metres: what an empty table has.
        contact_tolerance: by how much support may rise above a body's lowest point, metres.
        padding: how far around V, in x and y, values are kept, metres; beyond, the nearest counts.
    """

    def __init__(
        self,
        obstacles: ObstacleSet,
        volume: TargetVolume,
        beyond: float = 0.0,
        cap: float = CAP,
        contact_tolerance: float = 0.003,
        padding: float = 0.3,
    ) -> None:
        for name, value in (
            ("beyond", beyond),
            ("cap", cap),
            ("contact_tolerance", contact_tolerance),
            ("padding", padding),
        ):
            if not (math.isfinite(value) and value >= 0.0):
                raise ParameterError(name, value, "give a length of at least 0 m")
        grown = volume.joined + np.array([[-beyond], [beyond]])
        counted = counted_boxes(obstacles, grown)
        parts = _parts(volume.joined, np.array([padding, padding, 0.0]))
        near = [_near(obstacles, counted, part, cap) for part in parts]
        for part, boxes in zip(parts, near, strict=True):
            part[1, 2] = np.max(boxes.ends, initial=part[0, 2])
        step, rise = _spacing(parts[:, 1] - parts[:, 0], obstacles.cell_size)
        self.lift = contact_tolerance + (AROUND + 1) * rise
        self._tables = [
            _table(obstacles, boxes, part, step, rise, float(cap), self.lift)
            for part, boxes in zip(parts, near, strict=True)
        ]
        self._parts = parts
        aside = np.array([max(padding - _AT_ONCE, 0.0)] * 2)
        for table, part in zip(self._tables, parts, strict=True):
            table.around(part[0, :2] + aside, part[1, :2] - aside)
        self._extents: dict[int, tuple[Array, Array, Array, float]] = {}

    @property
    def tables(self) -> tuple[Table, ...]:
        """All values, one table for each part of V that lies apart."""
        return tuple(table.whole() for table in self._tables)

    def distance(self, points: Array) -> Array:
        """(n,) d_S around the (n, 3) points, whatever they may stand on, metres."""
        return np.asarray(self._evaluate(points)[:, 0])

    def gradient(self, points: Array) -> Array:
        """(n, 2) ∂d_S/∂x and ∂d_S/∂y at the (n, 3) points, of the interpolation itself."""
        return np.asarray(self._evaluate(points)[:, 1:])

    def _evaluate(self, points: Array) -> Array:
        points = _contiguous(points)
        found = np.empty((len(points), 3))
        for table, at in self._shares(points):
            here = _contiguous(points[at])
            found[at] = distances(table.around(here.min(axis=0), here.max(axis=0)), here)
        return found

    def mean_clearance(self, T_world_object: Array, points: Array) -> tuple[float, Array]:
        """C(x) of the clearance objective, and ∂C/∂(x, y, e_z) about the object's origin.

        Args:
            T_world_object: (4, 4).
            points: (n, 3), B_o in the object frame.

        Returns:
            The mean of d_S over B_o, metres; (3,) its change per metre, metre and radian.
        """
        values, gradients = self.mean_clearance_batch(np.asarray(T_world_object)[None], points)
        return float(values[0]), np.asarray(gradients[0])

    def mean_clearance_batch(
        self, T_world_object: Array, points: Array, slopes: bool = True
    ) -> tuple[Array, Array]:
        """(m,) and (m, 3): `mean_clearance` of the (m, 4, 4) poses; without `slopes` the latter are
        0, which takes less time.

        A body is judged by the part of V that its middle is nearest to.
        """
        T = _contiguous(T_world_object)
        if len(T) == 0 or len(points) == 0:
            return np.zeros(len(T)), np.zeros((len(T), 3))
        middle, half, radius = self._extent(points)
        points = _contiguous(points)
        if len(self._tables) == 1:
            x, y = T[:, 0, 3], T[:, 1, 3]
            known = self._tables[0].within(
                x.min() - radius, y.min() - radius, x.max() + radius, y.max() + radius
            )
            if known is not None:
                return mean_clearance(known, T, points, slopes)
        at = T[:, :2, :3] @ middle + T[:, :2, 3]
        reach = np.abs(T[:, :2, :3]) @ half
        if len(self._tables) == 1:
            table = self._tables[0].around((at - reach).min(axis=0), (at + reach).max(axis=0))
            return mean_clearance(table, T, points, slopes)
        values, gradients = np.empty(len(T)), np.empty((len(T), 3))
        for part, rows in self._shares(T[:, :3, :3] @ points.mean(axis=0) + T[:, :3, 3]):
            low, high = at[rows] - reach[rows], at[rows] + reach[rows]
            table = part.around(low.min(axis=0), high.max(axis=0))
            values[rows], gradients[rows] = mean_clearance(
                table, _contiguous(T[rows]), points, slopes
            )
        return values, gradients

    def _extent(self, points: Array) -> tuple[Array, Array, float]:
        """Middle (3,) of the box around points (n, 3), half of its sides, and how far they are from
        the origin; a little more."""
        known = self._extents.get(id(points))
        if known is None or known[0] is not points:
            low, high = points.min(axis=0), points.max(axis=0)
            radius = float(np.linalg.norm(points, axis=1).max()) + _ROUNDING
            known = points, 0.5 * (low + high), 0.5 * (high - low) + _ROUNDING, radius
            if len(self._extents) >= _BODIES:
                self._extents.clear()
            self._extents[id(points)] = known
        return known[1:]

    def _shares(self, points: Array) -> list[tuple[ClearanceTable, npt.NDArray[np.int64]]]:
        """Each table with those of the (n, 3) points that are nearest to it."""
        if len(self._tables) == 1:
            return [(self._tables[0], np.arange(len(points)))] if len(points) else []
        away = [np.maximum(np.maximum(low - points, points - high), 0.0)
                for low, high in self._parts]  # fmt: skip
        nearest = np.argmin((np.array(away)[..., :2] ** 2).sum(axis=2), axis=0)
        shares = [(table, np.flatnonzero(nearest == n)) for n, table in enumerate(self._tables)]
        return [(table, at) for table, at in shares if len(at)]


def _parts(boxes: Array, padding: Array) -> Array:
    """(m, 2, 3) boxes around those of (k, 2, 3) that would overlap in x and y, if `padding` (3,)
    were added on all sides; with the padding."""
    parts = boxes + np.stack([-padding, padding])
    n = 0
    while n < len(parts):
        beside = (parts[n + 1 :, 0] <= parts[n, 1]) & (parts[n + 1 :, 1] >= parts[n, 0])
        joined = np.flatnonzero(beside[:, :2].all(axis=1)) + n + 1
        if len(joined):
            rows = np.append(joined, n)
            parts[n] = parts[rows, 0].min(axis=0), parts[rows, 1].max(axis=0)
            parts = np.delete(parts, joined, axis=0)
            n = 0
        else:
            n += 1
    return parts


def _near(obstacles: ObstacleSet, counted: CountedBoxes, part: Array, cap: float) -> CountedBoxes:
    """Those boxes that count that may be within the cap of a part of V, beside it or above."""
    low, high = obstacles.lower[counted.rows, :2], obstacles.upper[counted.rows, :2]
    beside = (low <= part[1, :2] + cap) & (high >= part[0, :2] - cap)
    return counted.some(np.flatnonzero(beside.all(axis=1) & (counted.ends >= part[0, 2])))


def _spacing(sides: Array, cell_size: float) -> tuple[int, float]:
    """Cells between two lines of tables of sides (m, 3), m between their levels."""
    step, rise = 1, _LEVEL
    while True:
        lines = sides[:, :2] / (cell_size * step) + 4.0
        if (lines.prod(axis=1) * (sides[:, 2] / rise + 2.0 * AROUND + 5.0)).sum() <= MAX_VALUES:
            return step, rise
        # heights matter more: what is lower than three levels above what stands there is not seen
        if cell_size * step <= _FLATTER * rise:
            step *= 2
        else:
            rise *= 2.0


def _table(
    obstacles: ObstacleSet,
    counted: CountedBoxes,
    part: Array,
    step: int,
    rise: float,
    cap: float,
    lift: float,
) -> ClearanceTable:
    """The table of one part of V (2, 3), padding included, over the boxes that count."""
    size = obstacles.cell_size * step
    first, last = np.floor((part - obstacles.origin) / size).astype(np.int64)
    origin = obstacles.origin + first * size
    origin[2] = (math.floor(part[0, 2] / rise) - AROUND) * rise
    cut = sliced(counted, obstacles, float(origin[2]), rise)
    boxes = boxes_by_height(
        cut.outlines,
        (cut.cells[:, :2] // step - first[:2]).astype(np.int32),
        cut.bottoms,
        cut.ends,
        float(origin[2]),
        rise,
    )
    nx, ny = (last - first + 2)[:2].tolist()
    lines = Lines(float(origin[0]), float(origin[1]), size, cap)
    return ClearanceTable(boxes, lines, (nx, ny), origin, rise, lift)


def _contiguous(values: Array) -> Array:
    """Read-only, so that a kernel compiles once, whatever it is given."""
    view = np.ascontiguousarray(values, dtype=np.float64).view()
    view.setflags(write=False)
    return view
