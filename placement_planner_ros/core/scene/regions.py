"""R, the placement regions: contiguous surface in one plane, level or sloping."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.boxes import disjoint_rectangles
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.planes import Planes
from placement_planner_ros.core.scene.support import SupportMap
from placement_planner_ros.core.scene.surfaces import level_surfaces
from placement_planner_ros.core.scene.visibility import View
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.types import LEVEL, Array, Slope, TargetVolume, frozen_array

_EPSILON = 1e-7
ATTEMPTS = 100
"""To draw a point on a region: after so many in cut-off corners, the last stands."""
_BESIDE = 0.05
"""m beyond the heights in V at which surfaces may still carry what stands in it, and more."""
_SMALLEST = 1e-12
"""Parts of a region with less area than this are left out, m²."""


@dataclass(frozen=True, slots=True)
class RegionSettings(Settings):
    """What counts as a placement region.

    Attributes:
        headroom: free height above a surface for it to support anything.
        max_slope: see its words.
        max_tilt: what deviates by more from a plane's slope, from column to column, is not of it.
        height_tolerance: heights in one region differ from its mean by no more.
        max_side: larger regions are cut into tiles of at most this side.
        min_area: smaller regions are left out.
        max_regions: only so many are kept, the largest.
    """

    headroom: float = setting(0.03, "(0, inf)", "m")
    max_slope: float = setting(
        0.087,
        "[0, 0.26]",
        "rad",
        "Steepest surface that an object is placed on; it stands along the surface's normal. So "
        "that it does not slide, friction should be at least 1.5 times the tangent of that.",
    )
    max_tilt: float = setting(0.06, "(0, inf)", "rad")
    height_tolerance: float = setting(0.002, "(0, inf)", "m")
    max_side: float = setting(0.3, "(0, inf)", "m")
    min_area: float = setting(1e-4, "[0, inf)", "m²")
    max_regions: int = setting(200, "[1, inf)")


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """r: measured surface in one plane, as disjoint rectangles of x and y.

    Attributes:
        rectangles: (k, 4) xmin, ymin, xmax, ymax.
        z: z_r, metres; where the plane slopes, z at x = y = 0.
        diagonals: (k, 4) minimum and maximum of x + y and of x - y on each rectangle's surface:
            slanted edges cut corners off the rectangle. Not bounded unless given.
        slope: of the plane.
        areas: (k,) of the rectangles with their corners cut off, m².
        share: (k,) running sum of the rectangles' areas, corners included, m².
    """

    rectangles: Array
    z: float
    diagonals: Array = field(default_factory=lambda: np.zeros((0, 4)))
    slope: Slope = LEVEL
    areas: Array = field(init=False)
    share: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        rectangles = frozen_array(self.rectangles, (-1, 4))
        diagonals = self.diagonals
        if len(diagonals) == 0:
            diagonals = np.tile((-np.inf, np.inf), (len(rectangles), 2))
        object.__setattr__(self, "rectangles", rectangles)
        object.__setattr__(self, "diagonals", frozen_array(diagonals, (len(rectangles), 4)))
        areas, share = _areas(rectangles, self.diagonals)
        object.__setattr__(self, "areas", frozen_array(areas))
        object.__setattr__(self, "share", frozen_array(share))

    @property
    def area(self) -> float:
        """Surface, m², seen from above."""
        return float(self.areas.sum())

    def heights(self, xy: Array) -> Array:
        """(n,) z of the plane at (n, 2), metres."""
        return np.asarray(self.z + xy @ np.array(self.slope))

    def clipped(self, lower: Array, upper: Array) -> Region | None:
        """The part within lower..upper, (2,) corners, or None where nothing is left."""
        return self.within(np.array([(lower, upper)], dtype=np.float64))

    def within(self, section: Array) -> Region | None:
        """The part within any of (k, 2, 2) disjoint rectangles, or None where nothing is left."""
        parts = [_clip(self.rectangles, self.diagonals, low, high) for low, high in section]
        parts = [part for part in parts if len(part[0])]
        if not parts:
            return None
        rectangles, diagonals = (np.concatenate(of) for of in zip(*parts, strict=True))
        return Region(rectangles, self.z, diagonals, self.slope)

    def split(self) -> tuple[Region, ...]:
        """Up to four regions, cut at the area-weighted mean x and y (the paper's children of r).

        The parts cover this region exactly and may be split further, down to any size.
        """
        mean = (self.areas / self.areas.sum()) @ (
            0.5 * (self.rectangles[:, :2] + self.rectangles[:, 2:])
        )
        parts = []
        for right in (False, True):
            for back in (False, True):
                lower = np.where((right, back), mean, -np.inf)
                upper = np.where((right, back), np.inf, mean)
                part = self.clipped(lower, upper)
                if part is not None:
                    parts.append(part)
        return tuple(parts)

    def sample(self, rng: np.random.Generator) -> Array:
        """(3,) a point on the region, uniform by area.

        Draws in cut-off corners are refused; after 100 refusals the last stands, and s(x) decides.
        """
        share, last = self.share, len(self.share) - 1
        for _ in range(ATTEMPTS):
            pick, across, along = rng.random(3)
            k = min(int(share.searchsorted(pick * share[last], side="right")), last)
            x0, y0, x1, y1 = self.rectangles[k]
            x, y = x0 + across * (x1 - x0), y0 + along * (y1 - y0)
            low_plus, high_plus, low_minus, high_minus = self.diagonals[k]
            if low_plus <= x + y <= high_plus and low_minus <= x - y <= high_minus:
                break
        return np.array((x, y, self.z + self.slope[0] * x + self.slope[1] * y))


@kernel(lean=True)
def _half_square(length: float) -> float:
    """Area of the corner that a diagonal cuts off at this distance along both sides."""
    return 0.5 * length * length if length > 0.0 else 0.0


@kernel(lean=True)
def _area(rectangles: Array, diagonals: Array, k: int) -> float:
    """Area of rectangle k of (., 4) less the corners that its diagonals cut off."""
    x0, y0, x1, y1 = rectangles[k, 0], rectangles[k, 1], rectangles[k, 2], rectangles[k, 3]
    width, depth = x1 - x0, y1 - y0
    if width <= 0.0 or depth <= 0.0:
        return 0.0
    area = width * depth
    for corner in range(4):
        if corner == 0:
            reach = diagonals[k, 0] - (x0 + y0)
        elif corner == 1:
            reach = (x1 + y1) - diagonals[k, 1]
        elif corner == 2:
            reach = diagonals[k, 2] - (x0 - y1)
        else:
            reach = (x1 - y0) - diagonals[k, 3]
        if reach > 0.0:  # the corner's triangle, less what of it lies outside the rectangle
            area -= _half_square(reach) + _half_square(reach - width - depth)
            area += _half_square(reach - width) + _half_square(reach - depth)
    return max(area, 0.0)


@kernel()
def _areas(rectangles: Array, diagonals: Array) -> tuple[Array, Array]:
    """(k,) surface of each rectangle, and (k,) running sum of the whole rectangles' areas."""
    areas = np.empty(len(rectangles))
    share = np.empty(len(rectangles))
    total = 0.0
    for k in range(len(rectangles)):
        areas[k] = _area(rectangles, diagonals, k)
        total += (rectangles[k, 2] - rectangles[k, 0]) * (rectangles[k, 3] - rectangles[k, 1])
        share[k] = total
    return areas, share


@kernel()
def _clip(rectangles: Array, diagonals: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """What of the rectangles lies within lower..upper (2,), parts of no area left out."""
    inside = np.empty_like(rectangles)
    bounds = np.empty_like(rectangles)
    n = 0
    for k in range(len(rectangles)):
        inside[n, 0] = max(rectangles[k, 0], lower[0])
        inside[n, 1] = max(rectangles[k, 1], lower[1])
        inside[n, 2] = min(rectangles[k, 2], upper[0])
        inside[n, 3] = min(rectangles[k, 3], upper[1])
        bounds[n] = diagonals[k]
        if _area(inside, bounds, n) > _SMALLEST:
            n += 1
    return inside[:n].copy(), bounds[:n].copy()


@kernel(inline=True)
def _is_whole(bounds: Array, k: int) -> bool:
    """Whether no diagonal cuts rectangle k."""
    whole = True
    for a in range(bounds.shape[1]):
        whole = whole and abs(bounds[k, a]) == np.inf
    return whole


@kernel(nogil=True)
def _join_strips(
    cells: npt.NDArray[np.int64], rectangles: Array, diagonals: Array
) -> tuple[Array, Array]:
    """The same surface in fewer rectangles: whole ones next to each other in y joined.

    Args:
        cells: (k, 3) in lexicographic order.
    """
    joined = rectangles.copy()
    bounds = diagonals.copy()
    n = 0
    for k in range(len(cells)):
        joined[n] = rectangles[k]
        bounds[n] = diagonals[k]
        if (
            n > 0
            and cells[k, 0] == cells[k - 1, 0]
            and _is_whole(bounds, n)
            and _is_whole(bounds, n - 1)
            and joined[n, 0] == joined[n - 1, 0]
            and joined[n, 2] == joined[n - 1, 2]
            and abs(joined[n, 1] - joined[n - 1, 3]) <= _EPSILON
        ):
            joined[n - 1, 3] = joined[n, 3]
        else:
            n += 1
    return joined[:n].copy(), bounds[:n].copy()


def _heights(volume: TargetVolume, slope: Slope) -> tuple[float, float]:
    """The lowest and highest that a point of V is above the plane of a slope, metres."""
    rises = np.array([volume.lower[:2], volume.upper[:2]]) * np.array(slope)
    low = volume.lower[2] - rises.max(axis=0).sum()
    return float(low), float(volume.upper[2] - rises.min(axis=0).sum())


def find_regions(
    obstacles: ObstacleSet,
    volume: TargetVolume,
    settings: RegionSettings | None = None,
    planes: Planes | None = None,
    slope: Slope = LEVEL,
    sights: Sequence[View] = (),
) -> tuple[tuple[Region, ...], SupportMap]:
    """R of one slope within V, larger first, and the support of the whole obstacle set.

    A region is a set of 8-connected columns of level surface with `headroom` above, all within
    `height_tolerance` of their mean, cut into tiles of `max_side` and clipped to V. Its z is the
    area-weighted median of the heights of its surfaces. Surfaces that lie in a plane of another
    slope are neither part of a region nor support.

    Args:
        obstacles: sheared by the slope, so that what slopes by it is level.
        planes: which surfaces slope, and by how much; without, all are level.
        sights: see `SupportMap.of`.
    """
    settings = settings or RegionSettings()
    size = obstacles.cell_size
    nx, ny, _ = obstacles.shape
    belongs = None if planes is None else planes.belonging_to(slope)
    surfaces = level_surfaces(obstacles, settings.headroom, settings.max_tilt, belongs)
    start = surfaces.start
    lowest, highest = _heights(volume, slope)
    asked = (surfaces.height >= lowest - _BESIDE) & (surfaces.height <= highest + _BESIDE)
    support = SupportMap.of(obstacles, surfaces, slope, asked, sights)
    middle = 0.5 * (surfaces.rectangle[:, :2] + surfaces.rectangle[:, 2:])
    z = surfaces.height + middle @ np.array(slope)
    in_volume = np.zeros(len(surfaces.height), np.bool_)
    for lower, upper in volume.joined:
        in_volume |= (
            (z >= lower[2] - settings.height_tolerance)
            & (z <= upper[2] + settings.height_tolerance)
            & (surfaces.rectangle[:, 2:] > lower[:2]).all(axis=1)
            & (surfaces.rectangle[:, :2] < upper[:2]).all(axis=1)
        )
    if planes is not None:
        in_volume &= planes.lies_in(surfaces.cells, surfaces.height, slope)
    label = np.where(in_volume, 0, -1)
    cells = surfaces.cells.astype(np.int64)
    label = _connect(cells, start, surfaces.height, label, ny, nx, settings.height_tolerance)
    label = _tile(cells, label, size, settings.max_side)
    label = _connect(cells, start, surfaces.height, label, ny, nx, settings.height_tolerance)
    rectangle, surface = support.whole_parts()
    label = label[surface]
    order = np.argsort(label, kind="stable")
    order = order[label[order] >= 0]
    regions = []
    for parts in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        if len(parts) == 0:
            continue
        rows = surface[parts]
        whole = Region(rectangle[parts], 0.0, surfaces.diagonal[rows])
        if whole.area < settings.min_area:
            continue
        height = _weighted_median(surfaces.height[rows], whole.areas)
        # what slopes may lie in V in part
        flat = disjoint_rectangles(volume.joined[:, :, :2])
        section = volume.section(height) if slope == LEVEL else flat
        if not len(section):
            continue
        joined = _join_strips(cells[rows], rectangle[parts], surfaces.diagonal[rows])
        region = Region(joined[0], height, joined[1], slope).within(section)
        if region is not None and region.area >= settings.min_area:
            regions.append(region)
    return largest(regions, settings), support


def largest(regions: Iterable[Region], settings: RegionSettings) -> tuple[Region, ...]:
    """As many as are kept, larger first."""
    ordered = sorted(regions, key=lambda region: -region.area)
    return tuple(ordered[: settings.max_regions])


def _weighted_median(values: Array, weights: Array) -> float:
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def _tile(
    cells: npt.NDArray[np.int64], label: npt.NDArray[np.int64], size: float, max_side: float
) -> npt.NDArray[np.int64]:
    """Labels cut further so that none spans more than `max_side` in x or y."""
    rows = np.flatnonzero(label >= 0)
    if len(rows) == 0:
        return label
    groups = label[rows]
    count = int(np.max(groups)) + 1
    key = groups.copy()
    for axis in range(2):
        position = cells[rows, axis]
        low = np.full(count, np.iinfo(np.int64).max)
        high = np.full(count, np.iinfo(np.int64).min)
        np.minimum.at(low, groups, position)
        np.maximum.at(high, groups, position)
        span = (high - low + 1)[groups]
        per_tile = max(1, int(max_side / size + 1e-9))
        tiles = -(-span // per_tile)
        key = key * (int(np.max(tiles)) + 1) + (position - low[groups]) * tiles // span
    result = label.copy()
    result[rows] = np.unique(key, return_inverse=True)[1]
    return result


@kernel(nogil=True)
def _connect(
    cells: npt.NDArray[np.int64],
    start: npt.NDArray[np.int64],
    height: Array,
    group: npt.NDArray[np.int64],
    ny: int,
    nx: int,
    tolerance: float,
) -> npt.NDArray[np.int64]:
    """(s,) connected pieces of each group (group -1 is left out), level within the tolerance.

    A piece grows breadth-first from its first surface by those in the eight columns around that
    differ little in height from the one they are reached from and from the piece's mean so far.
    """
    label = np.full(len(cells), -1, np.int64)
    queue = np.empty(len(cells), np.int64)
    count = 0
    for seed in range(len(cells)):
        if group[seed] < 0 or label[seed] >= 0:
            continue
        label[seed] = count
        queue[0] = seed
        head, tail = 0, 1
        total = height[seed]
        while head < tail:
            s = queue[head]
            head += 1
            for i in range(max(cells[s, 0] - 1, 0), min(cells[s, 0] + 2, nx)):
                for j in range(max(cells[s, 1] - 1, 0), min(cells[s, 1] + 2, ny)):
                    for t in range(start[i * ny + j], start[i * ny + j + 1]):
                        if (
                            label[t] < 0
                            and group[t] == group[seed]
                            and abs(height[t] - height[s]) <= tolerance
                            and abs(height[t] - total / tail) <= tolerance
                        ):
                            label[t] = count
                            total += height[t]
                            queue[tail] = t
                            tail += 1
        count += 1
    return label
