"""Slopes of what was measured in V: planes that grow over the tops of boxes.

Surfaces that slope alike are looked at together, in heights above one plane of that slope, in which
they are level (`ObstacleSet.sheared`). So there is one notion of support, whatever it slopes by.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.boxes import within
from placement_planner_ros.core.scene.cloud import AROUND_M, CLEAR_M
from placement_planner_ros.core.scene.denoising import PLANE_POINTS
from placement_planner_ros.core.scene.grid import SKIN_M, ObstacleSet
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.types import (
    LEVEL,
    Array,
    Index,
    Mask,
    Slope,
    TargetVolume,
    kernel_input,
    steepness,
)
from placement_planner_ros.core.uncounted import Uncounted

MOST_SLOPES = 4
"""Slopes that are looked at, those of most surface; planes of others belong to none."""
UNOWNED, STEEP = -1, -2
"""Of what lies in none of the planes; of what lies in one that is too steep."""

_STEEPEST = math.tan(math.radians(20.0))
"""Slope of the steepest planes that are sought."""
_REACH = 3
"""Columns around a box whose tops show how the surface slopes there."""
_FEWEST = (_REACH + 1) ** 2
"""Boxes of the smallest plane."""
_SHEET = 2.0 * SKIN_M
"""m that a sheet counts as thick: a wall goes on in the cell above. What is no further from a
plane, in a clean cloud, is of it."""
_ALIKE = SKIN_M / RegionSettings().max_side
"""Slopes that differ by no more are one, so `max_slope` is kept to that: a skin over a tile."""


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A contiguous piece of surface that lies in one plane.

    Attributes:
        slope: of it.
        height: z at x = y = 0, metres.
        middle: (3,) of it, metres.
        area: about that of its columns of cells, m².
        scatter: standard deviation of the boxes' heights about it, or what noise makes of it at
            least, metres.
        spread: (2, 2) covariance of where the boxes lie in x and y, m².
        boxes: how many there are.
    """

    slope: Slope
    height: float
    middle: Array
    area: float
    scatter: float
    spread: Array
    boxes: int

    def tells_apart(self, slope: Slope, skin: float, deviations: float = 3.0) -> bool:
        """Whether it surely does not slope like that.

        Its heights would have to be off by more than noise explains within so many standard
        deviations, and by more than `skin` metres from one end to the other.
        """
        off = np.subtract(self.slope, slope)
        effect = float(off @ self.spread @ off)  # m², variance of the heights it makes
        # three by three boxes, projected onto one plane, err alike
        explained = (3.0 * deviations * self.scatter) ** 2 / self.boxes
        return bool(np.hypot(*off) > _ALIKE and 12.0 * effect > skin**2 and effect > explained)

    def passes(self, volume: TargetVolume, beside: float) -> bool:
        """Whether it comes into V, however far it goes on, or so many metres below or above it."""
        lower, upper = volume.boxes[:, 0], volume.boxes[:, 1]
        rises = np.stack([lower[:, :2], upper[:, :2]]) * np.array(self.slope)
        lowest = self.height + rises.min(axis=0).sum(axis=1)
        highest = self.height + rises.max(axis=0).sum(axis=1)
        enters = (lowest <= upper[:, 2] + beside) & (highest >= lower[:, 2] - beside)
        return bool(enters.any())


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """The planes of an obstacle set, by slope.

    Attributes:
        slopes: of those that are not level, that of most surface first.
        steep: planes steeper than `max_slope`, the largest first.
        tops: by slope, level among them, (k, 3) x, y and height above a plane of that slope of
            pieces of surface as large as a cell, with headroom: those in planes of it, of level
            also those in no plane that is known, beside others of about that height.
    """

    slopes: tuple[Slope, ...]
    steep: tuple[Plane, ...]
    tops: Mapping[Slope, Array]

    @classmethod
    def of(cls, obstacles: ObstacleSet, volume: TargetVolume, settings: RegionSettings) -> Planes:
        """Those in and around V."""
        found, label, means, free = _find_planes(obstacles, volume, settings.headroom)
        slopes: list[Slope] = []
        steep: list[Plane] = []
        owner_of = np.full(len(found) + 1, UNOWNED, np.int64)  # the last stands for none
        skin = obstacles.surface_tolerance
        for k in sorted(range(len(found)), key=lambda k: -found[k].area):
            plane = found[k]
            too_steep = steepness(plane.slope) > settings.max_slope + _ALIKE
            # level surfaces are many, and what stands along one that is off level by chance stands
            # on an edge: five deviations; three where it is too steep, as nothing stands there
            if not plane.tells_apart(LEVEL, skin, 3.0 if too_steep else 5.0):
                owner_of[k] = 0
                continue
            if too_steep:
                owner_of[k] = STEEP
                steep.append(plane)
                continue
            if not plane.passes(volume, obstacles.cell_size):
                continue  # such as the rim of a bin whose floor is meant
            alike = [n for n, slope in enumerate(slopes) if not plane.tells_apart(slope, skin)]
            if alike:
                owner_of[k] = 1 + alike[0]
            elif len(slopes) < MOST_SLOPES:
                slopes.append(plane.slope)
                owner_of[k] = len(slopes)
        owner, tops = owner_of[label], {}
        # what is higher than it is wide, however it slopes, is no surface, but the end of a wall
        x, y, z = (obstacles.upper - obstacles.lower).T
        flat = z <= np.minimum(x, y) + _STEEPEST * np.maximum(x, y) + skin + 0.5 * obstacles.noise
        for number, slope in enumerate((LEVEL, *slopes)):
            owned = (owner == number) | ((slope == LEVEL) & (owner == UNOWNED))
            along = means.copy()
            along[:, 2] -= along[:, :2] @ np.array(slope)
            beside = _level_beside(
                obstacles.arrays,
                kernel_input(along[:, 2]),
                owned & free,
                settings.height_tolerance,
                SKIN_M + obstacles.noise,
            )
            tops[slope] = along[(beside >= 2) & flat]  # a ledge goes on at both ends
        return cls(tuple(slopes), tuple(steep), tops)


@njit(cache=True, nogil=True)
def _level_beside(
    boxes: ObstacleArrays, height: Array, used: Mask, tolerance: float, rise: float
) -> Index:
    """(m,) in how many of the eight columns around each box another is about as high; 0 of those
    not used, and where it goes on up on one side and down on the other.

    Args:
        rise: m from one column to the next from which on it does.
    """
    nx, ny, nz = boxes.number_at.shape
    found = np.zeros(len(height), np.int64)
    for p in range(len(height)):
        if not used[p]:
            continue
        level = 0
        # two columns across from each other at a time
        for way in range(4):
            down, up = math.inf, -math.inf
            for side in range(-1, 2, 2):
                i = boxes.cells[p, 0] + side * (1, 0, 1, 1)[way]
                j = boxes.cells[p, 1] + side * (0, 1, 1, -1)[way]
                if i < 0 or i >= nx or j < 0 or j >= ny:
                    up = math.inf
                    continue
                # the step to the nearest in height of two cells below to two above; inf without
                best = math.inf
                for k in range(max(boxes.cells[p, 2] - 2, 0), min(boxes.cells[p, 2] + 3, nz)):
                    q = boxes.number_at[i, j, k] - 1
                    while q >= 0:
                        if used[q] and abs(height[q] - height[p]) < abs(best):
                            best = height[q] - height[p]
                        q = boxes.next[q]
                level += abs(best) <= tolerance
                down, up = min(down, best), max(up, best)
            # up on one side and down on the other: it is no surface of this slope
            if down < -rise and rise < up < math.inf:
                level = 0
                break
        found[p] = level
    return found


def _find_planes(
    obstacles: ObstacleSet, volume: TargetVolume, headroom: float
) -> tuple[list[Plane], Index, Array, Mask]:
    """The planes, which of them each box lies in (-1: none), the means (m, 3) of the boxes, and
    which of these have headroom."""
    tolerance = obstacles.surface_tolerance + 0.5 * obstacles.noise
    means, free = _box_tops(
        obstacles.arrays, obstacles.points, obstacles.first_point, headroom, tolerance
    )
    around = np.array([AROUND_M, AROUND_M, CLEAR_M])
    used = within(means, volume.lower - around, volume.upper + around) & free
    fits = _local_fits(obstacles.arrays, means, used, max(_SHEET, tolerance))
    # planes grow from where the fit is best
    order = np.argsort(fits[:, 3], kind="stable")
    order = order[np.isfinite(fits[order, 3])]
    label, moments, seeds = _grow_planes(
        obstacles.arrays, means, used, fits, order, max(_SHEET, tolerance)
    )
    # what is left of the noise where the fewest points make a plane
    least = obstacles.noise / math.sqrt(PLANE_POINTS)
    found = [
        _plane_of(row, about, obstacles.cell_size, least)
        for row, about in zip(moments, means[seeds], strict=True)
    ]
    # a standard deviation of one cell across it: four columns at least
    narrow = obstacles.cell_size**2
    wide = np.array([float(np.linalg.eigvalsh(each.spread)[0]) >= narrow for each in found], bool)
    number = np.append(np.where(wide, wide.cumsum() - 1, -1), -1)  # the last stands for none
    return (
        [each for each, kept in zip(found, wide, strict=True) if kept],
        number[label],
        means,
        free,
    )


def _plane_of(moments: Array, about: Array, cell_size: float, least: float) -> Plane:
    """From the second moments (4, 4) of (1, x, y, z) about a point (3,).

    Args:
        least: scatter that it has at least, metres.
    """
    number, mean = moments[0, 0], moments[0, 1:] / moments[0, 0]
    covariance = moments[1:, 1:] / number - np.outer(mean, mean)
    spread, along = covariance[:2, :2], covariance[:2, 2]
    slope = np.linalg.solve(spread, along)
    scatter = math.sqrt(max(float(covariance[2, 2] - slope @ along), 0.0))
    middle = about + mean
    return Plane(
        (float(slope[0]), float(slope[1])),
        float(middle[2] - slope @ middle[:2]),
        middle,
        float(number) * cell_size**2,
        max(scatter, least),
        spread,
        int(number),
    )


@njit(cache=True, nogil=True)
def _box_tops(
    boxes: ObstacleArrays,
    points: npt.NDArray[np.float32],
    first: Index,
    headroom: float,
    tolerance: float,
) -> tuple[Array, Mask]:
    """(m, 3) mean of the points of each box that are no further than the tolerance below the
    highest; (m,) whether there is free space above it: no other takes much of that room.

    A wall beside the surface takes a sliver of it, a thing on it much; a sheet counts as _SHEET
    thick, for a wall goes on in the cell above.

    Args:
        first: (m + 1,) the first point of each box, and their number.
    """
    cells, lower, upper = boxes.cells, boxes.lower, boxes.upper
    nz = boxes.number_at.shape[2]
    layers = int(headroom / boxes.cell_size) + 1
    means = np.zeros((len(cells), 3))
    # what lies above the highest layer was cropped away
    free = cells[:, 2] < nz - 1
    for p in range(len(cells)):
        highest, count = -math.inf, 0
        for point in range(first[p], first[p + 1]):
            highest = max(highest, points[point, 2])
        for point in range(first[p], first[p + 1]):
            if points[point, 2] >= highest - tolerance:
                count += 1
                for a in range(3):
                    means[p, a] += points[point, a]
        for a in range(3):
            means[p, a] /= count
        top = upper[p, 2]
        area = (upper[p, 0] - lower[p, 0] + _SHEET) * (upper[p, 1] - lower[p, 1] + _SHEET)
        # every other box of the column up to the headroom
        for k in range(cells[p, 2], min(cells[p, 2] + layers + 1, nz)):
            q = boxes.number_at[cells[p, 0], cells[p, 1], k] - 1
            while q >= 0 and free[p]:
                # the share of the top that is below it, where it is above the top
                if q != p and top + tolerance < upper[q, 2] and lower[q, 2] < top + headroom:
                    along_x = min(upper[p, 0], upper[q, 0]) - max(lower[p, 0], lower[q, 0])
                    along_y = min(upper[p, 1], upper[q, 1]) - max(lower[p, 1], lower[q, 1])
                    shared = max(0.0, along_x + _SHEET) * max(0.0, along_y + _SHEET)
                    free[p] = shared <= 0.3 * area
                q = boxes.next[q]
    return means, free


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _solve_slope(moments: Array) -> tuple[float, float, float, float, bool]:
    """Height at x = y = 0, slope and scatter of the plane of second moments (4, 4) of (1, x, y, z);
    whether there is one."""
    number = moments[0, 0]
    x, y, z = moments[0, 1] / number, moments[0, 2] / number, moments[0, 3] / number
    # variances and covariances of x, y and z
    xx, xy = moments[1, 1] / number - x * x, moments[1, 2] / number - x * y
    yy, xz = moments[2, 2] / number - y * y, moments[1, 3] / number - x * z
    yz, zz = moments[2, 3] / number - y * z, moments[3, 3] / number - z * z
    # none where the points are almost in line
    det = xx * yy - xy * xy
    if det <= 1e-3 * (xx + yy) ** 2:
        return 0.0, 0.0, 0.0, math.inf, False
    # the slope by least squares, and the deviation that is left
    gx, gy = (yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det
    return z - gx * x - gy * y, gx, gy, math.sqrt(max(zz - gx * xz - gy * yz, 0.0)), True


@njit(cache=True, nogil=True)
def _local_fits(boxes: ObstacleArrays, means: Array, used: Mask, tolerance: float) -> Array:
    """(m, 4) height above each box, slope and scatter of the plane around it; inf without one."""
    nx, ny, nz = boxes.number_at.shape
    fits = np.full((len(means), 4), np.inf)
    moments, away = np.empty((4, 4)), np.ones(4)  # away: (1, x, y, z) from the box
    layers = math.ceil(_STEEPEST * math.sqrt(2.0) * _REACH)
    for p in range(len(means)):
        if not used[p]:
            continue
        # moments of what lies around, as far up or down as a plane may rise to there
        moments[:] = 0.0
        ci, cj, ck = boxes.cells[p, 0], boxes.cells[p, 1], boxes.cells[p, 2]
        for i in range(max(ci - _REACH, 0), min(ci + _REACH + 1, nx)):
            for j in range(max(cj - _REACH, 0), min(cj + _REACH + 1, ny)):
                for k in range(max(ck - layers, 0), min(ck + layers + 1, nz)):
                    q = boxes.number_at[i, j, k] - 1
                    while q >= 0:
                        for a in range(3):
                            away[1 + a] = means[q, a] - means[p, a]
                        far = _STEEPEST * math.sqrt(away[1] ** 2 + away[2] ** 2) + tolerance
                        if used[q] and abs(away[3]) <= far:
                            for a in range(4):
                                for b in range(a, 4):  # the others are the same
                                    moments[a, b] += away[a] * away[b]
                        q = boxes.next[q]
        # the plane through enough of them that is not too steep
        if moments[0, 0] < _FEWEST:
            continue
        height, gx, gy, scatter, stands = _solve_slope(moments)
        if stands and gx * gx + gy * gy <= _STEEPEST * _STEEPEST:
            fits[p, 0] = height
            fits[p, 1], fits[p, 2], fits[p, 3] = gx, gy, scatter
    return fits


@njit(cache=True, nogil=True)
def _grow_planes(
    boxes: ObstacleArrays, means: Array, used: Mask, fits: Array, order: Index, tolerance: float
) -> tuple[Index, Array, Index]:
    """(m,) the plane that each box lies in, or -1; of each plane the second moments (k, 4, 4) of
    (1, x, y, z) about the box (k,) that it began with, and that.

    A plane begins with what was fitted around a box, and grows to neighbouring columns by the boxes
    within the tolerance of it; it is fitted anew each time that a quarter has come to it.
    """
    nx, ny, nz = boxes.number_at.shape
    size = boxes.cell_size
    label, tried = np.full(len(means), -1, np.int64), np.zeros(len(means), np.bool_)
    queue = np.empty(len(means), np.int64)
    most = len(means) // _FEWEST + 1
    found, seeds = np.empty((most, 4, 4)), np.empty(most, np.int64)
    away = np.ones(4)  # (1, x, y, z) from the seed
    count = 0
    for seed in order:
        if label[seed] >= 0 or tried[seed]:
            continue
        # a plane begins where what was fitted goes through the box itself
        height, gx, gy = fits[seed, 0], fits[seed, 1], fits[seed, 2]
        if abs(height) > tolerance:
            continue
        moments = found[count]
        moments[:] = 0.0
        moments[0, 0] = 1.0
        label[seed] = count
        queue[0] = seed
        head, tail, anew = 0, 1, 2 * _FEWEST
        while head < tail:
            # what is beside the next of its boxes, at its height there
            s = queue[head]
            head += 1
            for i in range(max(boxes.cells[s, 0] - 1, 0), min(boxes.cells[s, 0] + 2, nx)):
                for j in range(max(boxes.cells[s, 1] - 1, 0), min(boxes.cells[s, 1] + 2, ny)):
                    x = boxes.origin[0] + (i + 0.5) * size - means[seed, 0]
                    y = boxes.origin[1] + (j + 0.5) * size - means[seed, 1]
                    z = means[seed, 2] + height + gx * x + gy * y
                    layer = math.floor((z - boxes.origin[2]) / size)
                    for k in range(max(layer - 1, 0), min(layer + 2, nz)):
                        q = boxes.number_at[i, j, k] - 1
                        while q >= 0:
                            for a in range(3):
                                away[1 + a] = means[q, a] - means[seed, a]
                            off = away[3] - height - gx * away[1] - gy * away[2]
                            if used[q] and label[q] < 0 and abs(off) <= tolerance:
                                label[q] = count
                                queue[tail] = q
                                tail += 1
                                for a in range(4):
                                    for b in range(4):
                                        moments[a, b] += away[a] * away[b]
                            q = boxes.next[q]
            # anew, after a quarter more
            if tail >= anew:
                anew = tail + tail // 4
                level, along_x, along_y, _, stands = _solve_slope(moments)
                if stands:
                    height, gx, gy = level, along_x, along_y
        # a small one gives its boxes back, from which none begins again
        if tail >= _FEWEST and _solve_slope(moments)[4]:
            seeds[count] = seed
            count += 1
        else:
            for t in range(tail):
                label[queue[t]] = -1
                tried[queue[t]] = True
    return label, found[:count].copy(), seeds[:count].copy()
