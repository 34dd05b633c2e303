"""Walls: planes that stand, found in the obstacle set's points, each with a raster of its own.

Seen along its normal a wall is a layer like any other: in the wall's frame what was measured of it
is level, so `SupportMap` answers where it was measured, how far from its end, and how high it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.boxes import within
from placement_planner_ros.core.scene.cloud import AROUND_M, CLEAR_M
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.scene.grid import SKIN_M, ObstacleSet
from placement_planner_ros.core.scene.layers import SlopeCloud
from placement_planner_ros.core.scene.rasters import TILE_M
from placement_planner_ros.core.scene.support import SupportMap
from placement_planner_ros.core.types import LEVEL, Array, Index, Mask, TargetVolume

STEEPEST_LEAN_RAD = math.radians(15.0)
"""rad by which a wall may be from the vertical."""
FEWEST_POINTS, FEWEST_PATCHES = 8, 6
"""Points of the sparsest cube, and cubes of the smallest wall."""
OFF_PLANE_M = 3.0 * SKIN_M
"""m that points of a wall lie off its plane by at most, standard deviation, beside their noise."""
ALIKE_RAD = math.radians(8.0)
"""rad between the normals of cubes of one wall, as so few points tell them."""
MOST_WALLS, MOST_SEEDS = 16, 512
"""Walls, and cubes whose planes are looked at for them."""


@dataclass(frozen=True, eq=False)
class Wall:
    """One side of a plane that stands.

    Attributes:
        rotation: (3, 3) rows: along its foot, up along it, and its normal, out of it.
        offset: m from the origin along the normal.
        extent: (2, 2) its corners: least and greatest place along its foot and up along it, m.
    """

    rotation: Array
    offset: float
    extent: Array
    _points: npt.NDArray[np.float32] = field(repr=False)
    _measured: ObstacleSet = field(repr=False)
    _views: Sequence[View] = field(repr=False)

    def __str__(self) -> str:
        x, y = np.array([*self.extent.mean(axis=0), self.offset]) @ self.rotation[:, :2]
        faces = math.degrees(math.atan2(self.outward[1], self.outward[0]))
        return f"wall at ({x:.2f}, {y:.2f}) that faces {faces:.0f} degrees"

    @property
    def normal(self) -> Array:
        """(3,) unit, out of the wall."""
        return np.asarray(self.rotation[2])

    @property
    def tilt(self) -> float:
        """rad from the vertical; above 0 where it leans back."""
        return math.asin(float(self.rotation[2, 2]))

    @cached_property
    def outward(self) -> Array:
        """(2,) unit, horizontally out of the wall."""
        return np.asarray(self.rotation[2, :2] / np.hypot(*self.rotation[2, :2]))

    @property
    def top(self) -> float:
        """z up to where it was measured, metres."""
        return float(self.extent[1, 1] * self.rotation[1, 2] + self.offset * self.rotation[2, 2])

    @property
    def corners(self) -> Array:
        """(4, 3) of its extent, one after the other."""
        (left, low), (right, high) = self.extent
        at = [(left, low), (right, low), (right, high), (left, high)]
        return np.array([(*each, self.offset) for each in at]) @ self.rotation

    def foot_distance(self, points: Array) -> Array:
        """(n,) m horizontally from where the wall is at the height of points (n, 3)."""
        return np.asarray((points @ self.normal - self.offset) / math.cos(self.tilt))

    @cached_property
    def support(self) -> SupportMap:
        """What was measured of it, in coordinates of `rotation`."""
        measured, (low, high) = self._measured, self.extent
        # Points near its plane, turned so that it is level; BLAS would take all cores for them.
        away = np.einsum("nj,j", self._points, self.normal.astype(np.float32)) - self.offset
        points = self._points[np.abs(away) < 0.5 * CLEAR_M] @ self.rotation.T.astype(np.float32)
        corner = (low - 2.0 * TILE_M).astype(np.float32)
        points = points[within(points[:, :2], corner, high + 2.0 * TILE_M)]
        # The cells that have points on it.
        band = np.abs(points[:, 2] - self.offset) <= 2.0 * OFF_PLANE_M + measured.noise
        size = measured.cell_size
        cells = ((points[band, :2] - corner) / size).astype(np.int64)
        held = np.zeros(cells.max(axis=0, initial=0) + 1, np.bool_)
        held[tuple(cells.T)] = True
        middles = corner + (np.argwhere(held) + 0.5) * size
        tops = np.column_stack([middles, np.full(len(middles), self.offset)])
        turned = [View(v.points @ self.rotation.T, self.rotation @ v.origin) for v in self._views]
        around = TargetVolume([*low, self.offset - 1.0], [*high, self.offset + 1.0])
        cloud = SlopeCloud(points, around, LEVEL, tops, size, measured.noise, turned)
        return SupportMap(cloud)

    def is_seen(self) -> bool:
        """Whether a sensor before it measured it."""
        off, (low, high) = 2.0 * OFF_PLANE_M + self._measured.noise, self.extent
        for view in self._views:
            if view.origin @ self.normal > self.offset:
                on = view.points[np.abs(view.points @ self.normal - self.offset) <= off]
                at = on @ self.rotation[:2].T
                if ((at >= low) & (at <= high)).all(axis=1).sum() >= FEWEST_POINTS:
                    return True
        return False

    def is_behind(self, boxes: ObstacleSet, tolerance: float) -> Mask:
        """(m,) which boxes reach no further out of its plane than that, by their points where there
        are some: boxes stand out of what is askew."""
        n, most = self.normal, self.offset + tolerance
        out, into = np.maximum(n, 0.0), np.minimum(n, 0.0)
        behind = boxes.upper @ out + boxes.lower @ into <= most
        crossing = ~behind & (boxes.lower @ out + boxes.upper @ into <= most)
        rows = np.flatnonzero(crossing & (np.diff(boxes.first_point) > 0))
        if len(rows):
            first, count = boxes.first_point[rows], np.diff(boxes.first_point)[rows]
            begins = np.cumsum(count) - count
            points = boxes.points[np.repeat(first - begins, count) + np.arange(count.sum())]
            behind[rows] = np.maximum.reduceat(points @ n, begins) <= most
        return np.asarray(behind)


def find_walls(
    measured: ObstacleSet, volume: TargetVolume, views: Sequence[View]
) -> tuple[Wall, ...]:
    """The sides of every plane in and around V that stands which sensors saw, or both where none
    did: those of most surface first."""
    lower, upper = volume.lower - AROUND_M, volume.upper + AROUND_M
    points = measured.points[((measured.points >= lower) & (measured.points <= upper)).all(axis=1)]
    patches = _WallPatches.of(points.astype(np.float64))
    noise = OFF_PLANE_M + measured.noise
    standing = np.abs(patches.normals[:, 2]) <= math.sin(STEEPEST_LEAN_RAD + ALIKE_RAD)
    rows = np.flatnonzero(standing & (patches.scatter <= noise))
    # Which cubes are in one plane with each of some of them.
    seeds = np.arange(0, len(rows), len(rows) // MOST_SEEDS + 1)
    normals, middles = patches.normals[rows[seeds]], patches.middles[rows[seeds]]
    fits = patches.in_planes(rows, normals, (normals * middles).sum(axis=1), noise)
    left = np.ones(len(rows), np.bool_)
    walls: list[Wall] = []
    while left.sum() >= FEWEST_PATCHES and len(walls) < 2 * MOST_WALLS:
        # The cube that most others are in one plane with, and the plane of all these.
        many = (fits & left).sum(axis=1) * left[seeds]
        own = fits[np.argmax(many)] & left
        if own.sum() < FEWEST_PATCHES:
            break
        normal, offset, scatter = patches.plane(rows[own])
        own |= left & patches.in_planes(rows, normal[None], np.array([offset]), noise)[0]
        left &= ~own
        if abs(normal[2]) <= math.sin(STEEPEST_LEAN_RAD):
            both = []
            for side in (1.0, -1.0):
                rotation, extent = _foot_axes(side * normal, patches.middles[rows[own]])
                both.append(Wall(rotation, side * offset, extent, points, measured, tuple(views)))
            # Behind a side that was seen there may be more of the wall than a sheet.
            seen = [wall for wall in both if wall.is_seen()]
            # What is no noise is another side, of a sheet that is so thin.
            thick = math.sqrt(max(scatter**2 - measured.noise**2, 0.0))
            walls += seen if len(seen) == 1 else [replace(w, offset=w.offset + thick) for w in both]
    return tuple(walls)


def _foot_axes(normal: Array, middles: Array) -> tuple[Array, Array]:
    """`Wall.rotation` and `Wall.extent` of cubes with these middles (n, 3)."""
    along = np.array([-normal[1], normal[0], 0.0]) / np.hypot(normal[0], normal[1])
    rotation = np.stack([along, np.cross(normal, along), normal])
    at = middles @ rotation[:2].T
    return rotation, np.stack([at.min(axis=0) - 0.5 * TILE_M, at.max(axis=0) + 0.5 * TILE_M])


@dataclass(frozen=True, slots=True, eq=False)
class _WallPatches:
    """Points by cubes: how many, where, and how they are spread.

    Attributes:
        counts: (n,)
        middles: (n, 3) m.
        spreads: (n, 3, 3) covariances, m².
        normals: (n, 3) directions of least spread.
        scatter: (n,) m, standard deviation along these; infinite where points are few or in line.
    """

    counts: Array
    middles: Array
    spreads: Array
    normals: Array
    scatter: Array

    @classmethod
    def of(cls, points: Array) -> _WallPatches:
        cells = np.floor(points / TILE_M).astype(np.int64)
        cells -= cells.min(axis=0, initial=0)
        sizes = cells.max(axis=0, initial=0) + 1
        key = (cells[:, 0] * sizes[1] + cells[:, 1]) * sizes[2] + cells[:, 2]
        _, of, many = np.unique(key, return_inverse=True, return_counts=True)

        def mean(values: Array) -> Array:
            return np.bincount(of, weights=values, minlength=len(many)) / many

        middles = np.column_stack([mean(points[:, i]) for i in range(3)])
        off = points - middles[of]
        spreads = np.empty((len(many), 3, 3))
        for i in range(3):
            for j in range(3):
                spreads[:, i, j] = mean(off[:, i] * off[:, j])
        values, vectors = np.linalg.eigh(spreads)
        scatter = np.sqrt(np.maximum(values[:, 0], 0.0))
        scatter[(many < FEWEST_POINTS) | (values[:, 1] < (0.1 * TILE_M) ** 2)] = np.inf
        return cls(many.astype(np.float64), middles, spreads, vectors[:, :, 0], scatter)

    def plane(self, rows: Index) -> tuple[Array, float, float]:
        """Unit normal (3,) and offset, m, of the plane of all points of some cubes, and their
        standard deviation along it, m."""
        share = self.counts[rows] / self.counts[rows].sum()
        middle = share @ self.middles[rows]
        off = self.middles[rows] - middle
        spread = np.einsum("n,nij->ij", share, self.spreads[rows] + off[:, :, None] * off[:, None])
        values, vectors = np.linalg.eigh(spread)
        return vectors[:, 0], float(vectors[:, 0] @ middle), math.sqrt(max(float(values[0]), 0.0))

    def in_planes(self, rows: Index, normals: Array, offsets: Array, off: float) -> Mask:
        """(k, n) which of some cubes are of planes (k, 3) and (k,), their middles no further than
        so many metres off."""
        # in one thread, see `Wall.support`
        alike = np.abs(np.einsum("ki,ni", normals, self.normals[rows])) >= math.cos(ALIKE_RAD)
        away = np.abs(np.einsum("ki,ni", normals, self.middles[rows]) - offsets[:, None])
        return np.asarray(alike & (away <= off))
