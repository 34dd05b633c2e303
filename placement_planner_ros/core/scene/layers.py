"""Layers: what was measured at one height, as a raster of what carries there.

Heights are those above a plane of one slope through the origin, so that a sloping surface is a
layer, too. Of the points about the height of a layer a raster knows, at each place, how deep inside
of the surface it is, how far from where that ends, and how high the surface lies.

A place is *closed* where no disc without points covers it that is wider than chance explains
(`rasters`); the others are gaps. What rises above the layer counts as closed, too, and gaps
that begin behind it are no *ends* of the surface: a thing stands there. Rays that passed the layer
and were seen to end below it open it half the way to the nearest point.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.ndimage import label, map_coordinates, maximum_filter

from placement_planner_ros.core.scene.cloud import AROUND_M, CLEAR_M
from placement_planner_ros.core.scene.rasters import (
    TILE_M,
    Field,
    Mask,
    Raster,
    Rows,
    chance_radius,
    pixel_means,
    pixel_sums,
    widest_empty_disc,
    window_sums,
)
from placement_planner_ros.core.scene.visibility import View
from placement_planner_ros.core.types import Array, Slope, TargetVolume

LAYER_STEP_M = 0.001
"""m between the heights of layers: what is looked up is so at the nearest of them."""
RISE_FROM_M, RISE_TO_M = 0.005, 0.010
"""m above a layer between which points show that something stands there."""
SCATTER_NOISES = 1.5
"""Standard deviations of the noise that points are off their surface by at most, once smoothed."""
NOISY = 1.3
"""Times as wide are discs that chance explains where noise moves points sideways."""
PASSED_M, PASSED_NOISES = 0.005, 6.0
"""m, and standard deviations of the noise more, below a layer from which on a ray has passed it."""
PIXEL_M = 0.001, 0.0025
"""m, sides of the finest and of the coarsest pixels."""
FINEST_PIXELS = 60_000
"""Pixels of a layer up to which they are as fine as the spacing of its points asks for."""
NARROWEST_M, WIDEST_M = 0.002, 0.016
"""m, radii of the narrowest and of the widest disc without points that chance may explain."""
HOLE_M = 0.004
"""m, radius of the widest one where no rays tell: through what is wider a leg falls."""
SURE_RAYS = 12
"""Rays that ended about a place on the surface for each that passed it, to tell that it is whole:
if a quarter of it were open, three in a hundred times that many would by chance."""
TOP_WINDOW_M, FEWEST_ON_TOP = 0.01, 4
"""m, side of the square, and how many noisy points in it, whose mean is the top of something."""
SHEET_M = 0.0015
"""m below the highest point beside it from which on a point is not of the surface's top."""


class Layer(NamedTuple):
    """A raster (nx, ny) of one height; positions of pixels are those of their centres."""

    height: float
    """m, of the layer."""
    origin: Array
    """(2,) m, of the first pixel."""
    pixel: float
    """m between two pixels."""
    inside: Field
    """m from the nearest gap, some pixels at most; negative in gaps."""
    from_end: Field
    """m from where the surface drops or was not seen, negative beyond."""
    surface: Field
    """m, height of the surface."""
    top: Field
    """m, the highest point near the layer; -inf where there is none."""
    risen: Mask
    """Whether something stands there that rises from the layer."""
    sparse: float
    """Share of the surface that is lost to holes wider than `HOLE_M`, which may be chance."""


class SlopeCloud:
    """Points in and around V in heights above a plane, and the rays that they were seen by.

    Args:
        points: (n, 3) in the world, metres.
        tops: (k, 3) x, y and height of pieces of surface as large as a cell, with headroom: only
            what lies around these is surface.
        cell_size: metres.
        noise: standard deviation of the points before they were smoothed, metres.
        sights: what sensors at known places measured, not smoothed.
    """

    def __init__(
        self,
        points: npt.NDArray[np.floating],
        volume: TargetVolume,
        slope: Slope,
        tops: Array,
        cell_size: float,
        noise: float,
        sights: Sequence[View] = (),
    ) -> None:
        self.tops, self.cell_size = tops, cell_size
        self.slope, self.noise = slope, noise
        # no further below and above surfaces than anything is looked for there
        self._low = float(np.min(tops[:, 2], initial=np.inf)) - CLEAR_M
        high = float(np.max(tops[:, 2], initial=-np.inf)) + CLEAR_M
        steps = max(int((high - self._low) / LAYER_STEP_M) + 1, 0) if len(tops) else 0
        around = np.array([volume.lower[:2] - AROUND_M, volume.upper[:2] + AROUND_M])
        self._points, self._heights, self._start = _sorted_by_height(
            points, slope, around, self._low, steps
        )
        self._sights = [_Sight(view, slope) for view in sights]

    def between(self, low: float, high: float, columns: Mask, corner: Array) -> tuple[Array, Array]:
        """xy (n, 2) and heights (n,) of the points higher than `low` and no higher than `high`.

        Args:
            columns: (cx, cy) of cells from `corner` (2,) on, the only ones to look at; all if none.
        """
        first, last = (
            min(max(int((z - self._low) / LAYER_STEP_M) + k, 0), len(self._start) - 1)
            for k, z in enumerate((low, high))
        )
        rows = slice(self._start[first], self._start[last])
        found = self._points[rows], self._heights[rows]
        return _points_between(*found, (low, high), columns, corner, self.cell_size)

    def on_surface(self, height: float, reach: float, band: float) -> tuple[Array, Array, int]:
        """`between` of the points no more than `band` from a height, in the columns of tops no more
        than `reach` from it and in those beside; how many such tops there are."""
        near = self.tops[np.abs(self.tops[:, 2] - height) <= reach, :2]
        if len(near) == 0:
            return np.zeros((0, 2)), np.zeros(0), 0
        corner = near.min(axis=0) - 2.0 * self.cell_size
        # their columns of cells, and those beside
        cells = ((near - corner) / self.cell_size).astype(np.int64)
        columns = np.zeros(cells.max(axis=0) + 3, np.bool_)
        columns[tuple(cells.T)] = True
        columns = maximum_filter(columns, 3)
        return *self.between(height - band, height + band, columns, corner), len(near)

    def over(self, low: float, high: float) -> Array:
        """(n, 2) x and y of all points higher than `low` and no higher than `high`."""
        return self.between(low, high, np.zeros((0, 0), np.bool_), np.zeros(2))[0]

    def rays(self, height: float, band: float) -> tuple[Array, Array]:
        """(n, 2) where rays ended within the band about a height, and (m, 2) where those that ended
        well below passed it."""
        below = height - PASSED_M - PASSED_NOISES * self.noise
        none = np.zeros((0, 2))
        ended = [sight.ended(height - band, height + band) for sight in self._sights]
        passed = [sight.passed(height, below) for sight in self._sights]
        return np.concatenate([none, *ended]), np.concatenate([none, *passed])


class _Sight:
    """The rays of one view, in heights above a plane."""

    def __init__(self, view: View, slope: Slope) -> None:
        along = np.array(slope)
        points = view.points[np.isfinite(view.points).all(axis=1)]
        self._origin = view.origin[:2]
        self._from = float(view.origin[2] - self._origin @ along)
        heights = points[:, 2] - points[:, :2] @ along
        order = np.argsort(heights)
        self._ends, self._heights = points[order, :2], heights[order]

    def ended(self, low: float, high: float) -> Array:
        """(n, 2) ends between two heights."""
        return self._ends[slice(*self._heights.searchsorted((low, high)))]

    def passed(self, height: float, below: float) -> Array:
        """(n, 2) where rays crossed a height that ended below another."""
        if self._from <= height:
            return np.zeros((0, 2))
        rows = slice(self._heights.searchsorted(below))
        # where on the way from the sensor to its end a ray crosses the height
        share = (self._from - height) / (self._from - self._heights[rows])
        return self._origin + share[:, None] * (self._ends[rows] - self._origin)


def _with_corners(gap: Field, narrow: float) -> Field:
    """Discs of gaps, those of holes grown so that they reach into their corners.

    What discs leave closed of a corner between two wires is deep by (√2 - 1) times their radius,
    which of wide holes counts as that of a disc of `narrow`. What reaches the rim of the
    raster is no hole.
    """
    # gaps that do not reach the rim of the raster are holes
    labels, _ = label(gap > 0.0, structure=np.ones((3, 3)))
    rim = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    hole = (labels > 0) & ~np.isin(labels, rim)
    deep = np.float32(np.sqrt(2.0) - 1.0) * np.minimum(gap, np.float32(narrow))
    return np.where(hole, gap + deep, gap)


@njit(cache=True, nogil=True)
def _sorted_by_height(
    points: npt.NDArray[np.float32], slope: Slope, around: Array, low: float, steps: int
) -> tuple[Array, Array, Rows]:
    """A counting sort by height above a plane, in steps of `LAYER_STEP_M` from `low` on.

    Args:
        points: (n, 3), of which those between the corners `around` (2, 2) are kept.

    Returns:
        (k, 2) x and y, (k,) heights, and (steps + 1,) where each step begins.
    """
    start = np.zeros(steps + 1, np.int64)
    step_of = np.full(len(points), -1, np.int64)
    # how many there are of each step
    for p in range(len(points)):
        x, y = float(points[p, 0]), float(points[p, 1])
        if around[0, 0] <= x < around[1, 0] and around[0, 1] <= y < around[1, 1]:
            height = float(points[p, 2]) - slope[0] * x - slope[1] * y
            step = math.floor((height - low) / LAYER_STEP_M)
            if 0 <= step < steps:
                step_of[p] = step
                start[step + 1] += 1
    # where each step begins
    for step in range(steps):
        start[step + 1] += start[step]
    # each behind those of its step that are already there
    fill = start.copy()
    at, heights = np.empty((start[steps], 2)), np.empty(start[steps])
    for p in range(len(points)):
        if step_of[p] >= 0:
            row = fill[step_of[p]]
            fill[step_of[p]] += 1
            x, y = float(points[p, 0]), float(points[p, 1])
            at[row, 0], at[row, 1] = x, y
            heights[row] = float(points[p, 2]) - slope[0] * x - slope[1] * y
    return at, heights, start


@njit(cache=True, nogil=True)
def _points_between(
    points: Array,
    heights: Array,
    span: tuple[float, float],
    columns: Mask,
    corner: Array,
    size: float,
) -> tuple[Array, Array]:
    """`SlopeCloud.between` of points (n, 2) and heights (n,)."""
    at, kept = np.empty_like(points), np.empty_like(heights)
    count = 0
    for p in range(len(points)):
        if not span[0] < heights[p] <= span[1]:
            continue
        # only in the columns asked for
        x, y = points[p, 0], points[p, 1]
        if columns.size:
            i, j = math.floor((x - corner[0]) / size), math.floor((y - corner[1]) / size)
            if not (0 <= i < columns.shape[0] and 0 <= j < columns.shape[1] and columns[i, j]):
                continue
        at[count, 0], at[count, 1], kept[count] = x, y, heights[p]
        count += 1
    return at[:count].copy(), kept[:count].copy()


def make_layer(cloud: SlopeCloud, height: float, tolerance: float) -> Layer | None:
    """The layer at a height; None where nothing was measured there.

    Args:
        tolerance: m by which what carries may be above or below.
    """
    noise = cloud.noise
    # how far off the height points may be, and tops, with their noise
    band = tolerance + 0.5 * LAYER_STEP_M + SCATTER_NOISES * noise
    reach = tolerance + 0.5 * LAYER_STEP_M + 0.5 * noise
    on, heights, tops = cloud.on_surface(height, reach, band)
    if len(on) == 0:
        return None
    # what rises from there, above the band
    rise_from = max(band, RISE_FROM_M)
    over = cloud.over(height + rise_from, height + rise_from + RISE_TO_M - RISE_FROM_M)
    # about how far points are apart, and pixels that suit that
    spacing = cloud.cell_size * math.sqrt(tops / len(on))
    low, high = (np.array([of(on[:, 0]), of(on[:, 1])]) for of in (np.min, np.max))
    pixel = PIXEL_M[1] if noise > 0.0 else _pixel_side(spacing, high - low)
    raster = Raster(low, high, pixel, WIDEST_M + 2.0 * PIXEL_M[1])
    at = (on - raster.origin) / pixel
    measured, things = pixel_sums(at, heights, raster.shape), raster.counts(over)
    # what was measured about what rises is its foot
    risen = rises = things[0] > 0.0
    foot = max(1, round((spacing + noise) / pixel))
    if rises.any():
        risen = maximum_filter(rises, 2 * foot + 1)
    to_point, who = raster.nearest(np.vstack([pixel_means(measured), pixel_means(things)]))
    of_thing = np.append(risen[measured[0] > 0.0], np.ones(rises.sum(), np.bool_))[who]
    # gaps that are wider than chance explains, as discs around their pixels
    ended, passed = cloud.rays(height, band)
    # a sensor that saw nothing below tells nothing of holes
    ended = ended if len(passed) >= SURE_RAYS else ended[:0]
    ends, passes = raster.counts(ended), raster.counts(passed)
    times = NOISY if noise > 0.0 else 1.0
    widest, chance = _chance_discs(raster, to_point, measured[0], times)
    whole, hole = _whole_surface(raster, ends[0], passes[0]), HOLE_M / pixel
    radius = np.where(whole, chance, np.minimum(chance, hole))
    closed = widest <= chance
    sparse = float((widest[closed & ~whole] > hole).sum() / max(int(closed.sum()), 1))
    gap = _with_corners(np.where(to_point > radius, to_point, np.float32(0.0)), hole)
    # a ray opens half of the way to the nearest point, and the four pixels around it at least
    rays = pixel_means(passes)
    away = map_coordinates(to_point, rays.T, order=1, mode="nearest")
    opened = np.maximum(0.5 * away, np.minimum(away, 0.75))
    discs = np.vstack([_pixel_discs(gap), np.column_stack([rays, opened])])
    i, j = (discs[:, :2] + 0.5).astype(np.int64).T
    # gaps behind things are no ends
    behind = of_thing[i, j]
    from_end = raster.nearest(discs[~behind])[0]
    inside = np.minimum(from_end, raster.nearest(discs[behind], max(hole, 2.0))[0])
    averaged = TILE_M if noise > 0.0 else float(np.median(radius)) * pixel
    # of the points, those of the surface's top, and none of things' feet if there are others
    least = maximum_filter(measured[4], 3) - SHEET_M - 2.0 * noise
    sums = _sums_from(at, heights, np.where(risen, np.inf, least), height)
    if not sums[0].any():
        sums = _sums_from(at, heights, least, height)
    # within the widest disc, and beyond things' feet, something was measured
    far = 2 * (math.ceil(float(radius.max())) + foot) + 1
    surface = _surface_heights(sums, noise, (far, raster.width(averaged))) + np.float32(height)
    return Layer(
        height,
        raster.origin,
        pixel,
        inside * np.float32(pixel),
        from_end * np.float32(pixel),
        surface,
        _highest_points(raster, measured, noise),
        risen,
        sparse,
    )


def _pixel_side(spacing: float, sides: Array) -> float:
    """m: about half of what the points are apart, coarser where the layer is large."""
    area = float((sides + 2.0 * WIDEST_M).prod())
    return float(np.clip(max(0.5 * spacing, np.sqrt(area / FINEST_PIXELS)), *PIXEL_M))


def _chance_discs(
    raster: Raster, to_point: Field, count: Array, times: float
) -> tuple[Field, Field]:
    """(nx, ny) pixels: the radius of the widest disc without points that covers each pixel, and of
    the widest that chance may explain."""
    pixel = raster.pixel
    widest = widest_empty_disc(to_point, WIDEST_M / pixel + 1.0)
    radius = chance_radius(widest * np.float32(pixel), count, pixel, NARROWEST_M, WIDEST_M)
    return widest, np.minimum(radius * np.float32(times), np.float32(WIDEST_M)) / np.float32(pixel)


def _whole_surface(raster: Raster, ended: Array, passed: Array) -> Mask:
    """(nx, ny) whether rays tell that the surface about a pixel has no holes of some share."""
    if not ended.any():
        return np.zeros(raster.shape, np.bool_)
    on, through = window_sums(np.stack([ended, passed]), raster.width(3.0 * TILE_M))
    return np.asarray(on > SURE_RAYS * (through + 1.0) - 0.5)


def _pixel_discs(radius: Field) -> Array:
    """(n, 3) pixels, and radii, of the pixels (nx, ny) whose radius is above 0."""
    i, j = np.nonzero(radius > 0.0)
    return np.column_stack([i, j, radius[i, j]])


@njit(cache=True, nogil=True)
def _sums_from(at: Array, heights: Array, least: Array, low: float) -> Array:
    """(3, nx, ny) of each pixel: how many of the points (n, 2), in pixels, and heights (n,) are no
    lower than `least` (nx, ny), and the sums of their heights above `low` and of the squares."""
    sums = np.zeros((3, *least.shape))
    for p in range(len(at)):
        i, j = int(at[p, 0] + 0.5), int(at[p, 1] + 0.5)
        if heights[p] >= least[i, j]:
            off = heights[p] - low
            sums[0, i, j] += 1.0
            sums[1, i, j] += off
            sums[2, i, j] += off * off
    return sums


def _surface_heights(sums: Array, noise: float, widths: tuple[int, int]) -> Field:
    """(nx, ny) m, heights of the surface from `_sums_from`; inf far from all points.

    Args:
        widths: pixels along the squares over which heights are averaged, those that hold where
            the second hold no point first.
    """
    surface = np.full(sums.shape[1:], np.inf)
    for width in widths:  # what is near counts where there is any
        count, total, squares = window_sums(sums, width)
        held = count > 0.5
        surface[held] = total[held] / count[held]
    if noise > 0.0:  # between two levels there is no surface
        count = np.maximum(count, 1.0)
        surface[held & (squares / count - (total / count) ** 2 > noise**2)] = np.inf
    return surface.astype(np.float32)


def _highest_points(raster: Raster, measured: Array, noise: float) -> Field:
    """(nx, ny) m, the highest point under what touches there, of `pixel_sums` of all."""
    top = measured[4]
    if noise > 0.0:  # single points say nothing
        many, total = window_sums(measured[[0, 3]], raster.width(TOP_WINDOW_M))
        top = np.where(many > FEWEST_ON_TOP - 0.5, total / np.maximum(many, 1.0), -np.inf)
    # what lies within a coarse pixel beside a point that touches is under the object
    wide = 2 * int(np.ceil(PIXEL_M[1] / raster.pixel)) + 1
    return np.asarray(maximum_filter(top, wide).astype(np.float32))
