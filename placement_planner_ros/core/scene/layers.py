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
    WIDEST,
    Field,
    Mask,
    Raster,
    Rows,
    chance_radius,
    points_within,
    widest_empty_disc,
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
BESIDE_A_THING = 0.75
"""Widest discs by chance from what rises within which points are taken for its foot."""
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
    """m from the nearest gap, negative in gaps."""
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

    def between(self, low: float, high: float) -> tuple[Array, Array]:
        """xy (n, 2) and heights (n,) of the points higher than `low` and no higher than `high`."""
        first, last = (
            min(max(int((z - self._low) / LAYER_STEP_M) + k, 0), len(self._start) - 1)
            for k, z in enumerate((low, high))
        )
        rows = slice(self._start[first], self._start[last])
        heights = self._heights[rows]
        within = (heights > low) & (heights <= high)
        return self._points[rows][within], heights[within]

    def on_surface(self, height: float, reach: float, band: float) -> tuple[Array, Array, int]:
        """`between` of the points no more than `band` from a height, in the columns of tops no more
        than `reach` from it and in those beside; how many such tops there are."""
        near = self.tops[np.abs(self.tops[:, 2] - height) <= reach, :2]
        if len(near) == 0:
            return np.zeros((0, 2)), np.zeros(0), 0
        points, heights = self.between(height - band, height + band)
        low = near.min(axis=0) - 2.0 * self.cell_size
        cells = ((near - low) / self.cell_size).astype(np.int64)
        filled = np.zeros(cells.max(axis=0) + 3, np.bool_)
        filled[tuple(cells.T)] = True
        filled = maximum_filter(filled, 3)
        kept = np.flatnonzero(
            points_within(points, low, low + self.cell_size * np.array(filled.shape))
        )
        i, j = ((points[kept] - low) / self.cell_size).astype(np.int64).T
        kept = kept[filled[i.clip(max=len(filled) - 1), j.clip(max=filled.shape[1] - 1)]]
        return points[kept], heights[kept], len(near)

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
        share = (self._from - height) / (self._from - self._heights[rows])
        return self._origin + share[:, None] * (self._ends[rows] - self._origin)


def _with_corners(gap: Field, narrow: float) -> Field:
    """Discs of gaps, those of holes grown so that they reach into their corners.

    What discs leave closed of a corner between two wires is deep by (√2 - 1) times their radius,
    which of wide holes counts as that of a disc of `narrow`. What reaches the rim of the
    raster is no hole.
    """
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


def make_layer(cloud: SlopeCloud, height: float, tolerance: float) -> Layer | None:
    """The layer at a height; None where nothing was measured there.

    Args:
        tolerance: m by which what carries may be above or below.
    """
    noise = cloud.noise
    band = tolerance + 0.5 * LAYER_STEP_M + SCATTER_NOISES * noise
    reach = tolerance + 0.5 * LAYER_STEP_M + 0.5 * noise
    on, heights, tops = cloud.on_surface(height, reach, band)
    if len(on) == 0:
        return None
    rise_from = max(band, RISE_FROM_M)
    over, _ = cloud.between(height + rise_from, height + rise_from + RISE_TO_M - RISE_FROM_M)
    raster = Raster(on, _pixel_side(cloud, on, tops), WIDEST_M + 2.0 * PIXEL_M[1])
    pixel = raster.pixel
    at, rises = raster.at(on), raster.middles(raster.at(over))
    middles = raster.middles(at)
    # gaps that are wider than chance explains, as discs around their pixels
    to_point = raster.distance(np.vstack([middles, rises]))
    ended, passed = cloud.rays(height, band)
    # a sensor that saw nothing below tells nothing of holes
    ended = ended if len(passed) >= SURE_RAYS else ended[:0]
    ended, passed = raster.at(ended), raster.at(passed)
    widest, chance = _chance_discs(raster, to_point, at, NOISY if noise > 0.0 else 1.0)
    whole, hole = _whole_surface(raster, ended, passed), HOLE_M / pixel
    radius = np.where(whole, chance, np.minimum(chance, hole))
    closed = widest <= chance
    sparse = float((widest[closed & ~whole] > hole).sum() / max(int(closed.sum()), 1))
    gap = _with_corners(np.where(to_point > radius, to_point, np.float32(0.0)), hole)
    # a ray opens half of the way to the nearest point, and the four pixels around it at least
    rays = raster.middles(passed) if len(passed) else passed
    away = map_coordinates(to_point, rays.T, order=1, mode="nearest")
    opened = np.maximum(0.5 * away, np.minimum(away, 0.75))
    inside = _from_discs(raster, gap, rays, opened)
    # what is not beside what rises is surface, and gaps nearer to that are ends
    from_end, plain, risen = inside, np.ones(len(at), np.bool_), np.zeros(raster.shape, np.bool_)
    if len(rises):
        to_rise = raster.distance(rises)
        risen = to_rise <= radius / WIDEST
        plain = (to_rise > BESIDE_A_THING * radius).ravel()[raster.cells(at)]
        drops = raster.distance(raster.middles(at[plain])) <= to_rise
        of_rays = drops.ravel()[raster.cells(rays)]
        from_end = _from_discs(
            raster, np.where(drops, gap, np.float32(0.0)), rays[of_rays], opened[of_rays]
        )
    surface, top = _layer_heights(raster, at, heights, plain, noise, radius, inside)
    return Layer(
        height,
        raster.origin,
        pixel,
        inside * np.float32(pixel),
        from_end * np.float32(pixel),
        surface,
        top,
        risen,
        sparse,
    )


def _pixel_side(cloud: SlopeCloud, points: Array, tops: int) -> float:
    """m: about half of what the points are apart, coarser where the layer is large or noisy."""
    if cloud.noise > 0.0:
        return PIXEL_M[1]
    spacing = cloud.cell_size * np.sqrt(tops / len(points))
    area = float((np.ptp(points, axis=0) + 2.0 * WIDEST_M).prod())
    return float(np.clip(max(0.5 * spacing, np.sqrt(area / FINEST_PIXELS)), *PIXEL_M))


def _chance_discs(raster: Raster, to_point: Field, at: Array, times: float) -> tuple[Field, Field]:
    """(nx, ny) pixels: the radius of the widest disc without points that covers each pixel, and of
    the widest that chance may explain."""
    pixel = raster.pixel
    widest = widest_empty_disc(to_point, WIDEST_M / pixel + 1.0)
    radius = chance_radius(widest * np.float32(pixel), at, pixel, NARROWEST_M, WIDEST_M)
    return widest, np.minimum(radius * np.float32(times), np.float32(WIDEST_M)) / np.float32(pixel)


def _whole_surface(raster: Raster, ended: Array, passed: Array) -> Mask:
    """(nx, ny) whether rays tell that the surface about a pixel has no holes of some share."""
    if len(ended) == 0:
        return np.zeros(raster.shape, np.bool_)
    on, through = (
        raster.sums(raster.cells(at), np.ones(len(at)), 3.0 * TILE_M) for at in (ended, passed)
    )
    return np.asarray(on > SURE_RAYS * (through + 1.0) - 0.5)


def _from_discs(raster: Raster, gap: Field, rays: Array, opened: Array) -> Field:
    """(nx, ny) signed distance, in pixels, from the union of discs of radii (nx, ny) around
    pixels, and of radii (n,) about rays (n, 2)."""
    i, j = np.nonzero(gap > 0.0)
    centres = np.vstack([np.column_stack([i, j]), rays])
    return raster.distance(centres, np.append(gap[i, j].astype(np.float64), opened))


def _layer_heights(
    raster: Raster,
    at: Array,
    heights: Array,
    plain: Mask,
    noise: float,
    radius: Field,
    inside: Field,
) -> tuple[Field, Field]:
    """(nx, ny) m, height of the surface, and of the highest point of each pixel."""
    cell, size = raster.cells(at), raster.shape[0] * raster.shape[1]
    top = np.full(size, -np.inf)
    np.maximum.at(top, cell, heights)
    highest = maximum_filter(top.reshape(raster.shape), 3).ravel()
    kept = plain & (heights >= highest[cell] - SHEET_M - 2.0 * noise)
    if not kept.any():
        kept = plain if plain.any() else np.ones(len(at), np.bool_)
    low = float(heights[kept].mean())
    side = TILE_M if noise > 0.0 else float(np.median(radius)) * raster.pixel
    off, own = heights[kept] - low, cell[kept]
    count, total = (raster.sums(own, off**power, side) for power in range(2))
    held = count > 0.5
    mean = np.where(held, total / np.maximum(count, 1e-9), 0.0)
    surface = mean + low
    if noise > 0.0:  # between two levels there is no surface
        squares = raster.sums(own, off**2, side)
        surface[held & (squares / np.maximum(count, 1e-9) - mean**2 > noise**2)] = np.inf
    if not held[inside > -2.0].all():  # further away the nearest holds
        _, who = raster.nearest(np.argwhere(held).astype(np.float64))
        surface = surface[held][who]
    if noise > 0.0:  # single points say nothing
        many, sums = (raster.sums(cell, (heights - low) ** p, TOP_WINDOW_M) for p in range(2))
        top = np.where(many > FEWEST_ON_TOP - 0.5, sums / np.maximum(many, 1.0) + low, -np.inf)
    # what lies within a coarse pixel beside a point that touches is under the object
    beside = 2 * int(np.ceil(PIXEL_M[1] / raster.pixel)) + 1
    highest = maximum_filter(top.reshape(raster.shape), beside)
    return surface.astype(np.float32), highest.astype(np.float32)
