"""Walls: planes that stand, found in the obstacle set's points, each with a raster of its own.

Seen along its normal a wall is a layer like any other: in the wall's frame what was measured of it
is level, so `SupportMap` answers where it was measured, how far from its end, and how high it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.layers import SlopeCloud
from placement_planner_ros.core.scene.support import SupportMap
from placement_planner_ros.core.scene.visibility import View
from placement_planner_ros.core.types import LEVEL, Array, TargetVolume

STEEPEST_LEAN_RAD = math.radians(15.0)
"""rad by which a wall may be from the vertical."""
AROUND_M = 0.3
"""m around V in which walls are sought."""
PATCH_M = 0.03
"""m, side of the cubes whose points are looked at together."""
FEWEST_POINTS, FEWEST_PATCHES = 8, 6
"""Points of the sparsest cube, and cubes of the smallest wall."""
OFF_PLANE_M = 0.0015
"""m that points of a wall lie off its plane by at most, standard deviation, beside their noise."""
ALIKE_RAD = math.radians(8.0)
"""rad between the normals of cubes of one wall, as so few points tell them."""
MOST_WALLS = 16
NEAR_M = 0.05
"""m before and behind a wall in which points matter to its raster."""


@dataclass(frozen=True, eq=False)
class Wall:
    """One side of a plane that stands.

    Attributes:
        rotation: (3, 3) rows: along its foot, up along it, and its normal, out of it.
        offset: m from the origin along the normal.
        extent: (2, 2) least and greatest coordinate along its foot, and up along it, m.
    """

    rotation: Array
    offset: float
    extent: Array
    _environment: Environment = field(repr=False)

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

    def foot_distance(self, points: Array) -> Array:
        """(n,) m horizontally from where the wall is at the height of points (n, 3)."""
        return np.asarray((points @ self.normal - self.offset) / math.cos(self.tilt))

    @cached_property
    def support(self) -> SupportMap:
        """What was measured of it, in coordinates of `rotation`."""
        measured, space = self._environment.measured, self._environment.seen_space
        points = measured.points @ self.rotation.T.astype(np.float32)
        points = points[np.abs(points[:, 2] - self.offset) < NEAR_M]
        band = np.abs(points[:, 2] - self.offset) <= 2.0 * OFF_PLANE_M + measured.noise
        size = measured.cell_size
        cells = np.unique(np.floor(points[band, :2] / size).astype(np.int64), axis=0)
        tops = np.column_stack([(cells + 0.5) * size, np.full(len(cells), self.offset)])
        views = () if space is None else space.views
        turned = [View(v.points @ self.rotation.T, self.rotation @ v.origin) for v in views]
        low, high = self.extent
        around = TargetVolume([*low, self.offset - 1.0], [*high, self.offset + 1.0])
        cloud = SlopeCloud(points, around, LEVEL, tops, size, measured.noise, turned)
        return SupportMap(cloud)

    @cached_property
    def box_reach(self) -> Array:
        """(m,) m by which each box of the obstacle set reaches out of the wall's plane."""
        boxes = self._environment.obstacles
        n = self.normal
        reach = np.maximum(boxes.lower * n, boxes.upper * n).sum(axis=1)
        rows = np.flatnonzero(np.diff(boxes.first_point))
        if len(rows):  # by the points where there are some: boxes stand out of what is askew
            along = boxes.points.astype(np.float64) @ n
            reach[rows] = np.maximum.reduceat(along, boxes.first_point[rows])
        return np.asarray(reach - self.offset)


def find_walls(environment: Environment) -> tuple[Wall, ...]:
    """Both sides of every plane in and around V that stands, those of most surface first."""
    measured, volume = environment.measured, environment.volume
    lower, upper = volume.lower - AROUND_M, volume.upper + AROUND_M
    points = measured.points.astype(np.float64)
    points = points[((points >= lower) & (points <= upper)).all(axis=1)]
    patches = _Patches.of(points)
    noise = OFF_PLANE_M + measured.noise
    standing = np.abs(patches.normals[:, 2]) <= math.sin(STEEPEST_LEAN_RAD + ALIKE_RAD)
    left = np.flatnonzero(standing & (patches.scatter <= noise))
    walls: list[Wall] = []
    while len(left) >= FEWEST_PATCHES and len(walls) < 2 * MOST_WALLS:
        # The cube that most others are in one plane with, and the plane of all these.
        many = [
            patches.in_plane(left, *patches.plane(left[k : k + 1]), noise).sum()
            for k in range(len(left))
        ]
        own = left[patches.in_plane(left, *patches.plane(left[[np.argmax(many)]]), noise)]
        if len(own) < FEWEST_PATCHES:
            break
        normal, offset = patches.plane(own)
        own = np.union1d(own, left[patches.in_plane(left, normal, offset, noise)])
        left = np.setdiff1d(left, own)
        if abs(normal[2]) <= math.sin(STEEPEST_LEAN_RAD):
            middles = patches.middles[own]
            walls += [_wall(environment, side * normal, side * offset, middles) for side in (1, -1)]
    return tuple(walls)


def _wall(environment: Environment, normal: Array, offset: float, middles: Array) -> Wall:
    along = np.array([-normal[1], normal[0], 0.0]) / np.hypot(normal[0], normal[1])
    rotation = np.stack([along, np.cross(normal, along), normal])
    at = middles @ rotation[:2].T
    extent = np.stack([at.min(axis=0) - 0.5 * PATCH_M, at.max(axis=0) + 0.5 * PATCH_M])
    return Wall(rotation, offset, extent, environment)


@dataclass(frozen=True, slots=True, eq=False)
class _Patches:
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
    def of(cls, points: Array) -> _Patches:
        cells = np.floor(points / PATCH_M).astype(np.int64)
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
        scatter[(many < FEWEST_POINTS) | (values[:, 1] < (0.1 * PATCH_M) ** 2)] = np.inf
        return cls(many.astype(np.float64), middles, spreads, vectors[:, :, 0], scatter)

    def plane(self, rows: npt.NDArray[np.int64]) -> tuple[Array, float]:
        """Unit normal (3,) and offset, m, of the plane of all points of some cubes."""
        share = self.counts[rows] / self.counts[rows].sum()
        middle = share @ self.middles[rows]
        off = self.middles[rows] - middle
        spread = np.einsum("n,nij->ij", share, self.spreads[rows] + off[:, :, None] * off[:, None])
        normal = np.linalg.eigh(spread)[1][:, 0]
        return normal, float(normal @ middle)

    def in_plane(
        self, rows: npt.NDArray[np.int64], normal: Array, offset: float, off: float
    ) -> npt.NDArray[np.bool_]:
        """Which of some cubes are of a plane, their middles no further than so many metres off."""
        alike = np.abs(self.normals[rows] @ normal) >= math.cos(ALIKE_RAD)
        return np.asarray(alike & (np.abs(self.middles[rows] @ normal - offset) <= off))
