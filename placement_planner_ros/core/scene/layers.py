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
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.ndimage import label, map_coordinates

from placement_planner_ros.core.boxes import within
from placement_planner_ros.core.scene.cloud import AROUND_M, SAMPLES, STEP_M, SURE_NOISES
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.scene.rasters import (
    AREA_PER_POINT,
    GROWTH,
    MOST_PIXELS,
    SURE_COUNT,
    TILE_M,
    WIDEST,
    Field,
    hand_on_nearest,
    pixel_sums,
    widest_empty_disc,
    window_sums,
)
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import (
    SINGLE_ROUNDING,
    Array,
    Index,
    Index32,
    Mask,
    Slope,
    TargetVolume,
)

_AnyImage = TypeVar("_AnyImage", bound=npt.NDArray)

LAYER_STEP_M = 0.001
"""m between the heights of layers: what is looked up is so at the nearest of them."""
PASSED_NOISES = 1.5 * SURE_NOISES
"""Standard deviations of the noise by which a ray that has passed a layer ends below it, and
`STEP_M` more: both its end and the layer are noisy."""
PIXEL_M = 0.001, 0.0025
"""m, sides of the finest and of the coarsest pixels."""
NARROWEST_M, WIDEST_M = 0.002, 0.016
"""m, radii of the narrowest and of the widest disc without points that chance may explain."""
HOLE_M = 0.004
"""m, radius of the widest one where no rays tell: through what is wider a leg falls."""
CORNER = math.sqrt(2.0) - 1.0
"""Share of a disc's radius by which the corner of a square around it is deep."""
TOP_WINDOW_M, FEWEST_ON_TOP = 0.01, 4
"""m, side of the square, and how many noisy points in it, whose mean is the top of something."""


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


@dataclass(frozen=True, eq=False)
class SlopeCloud:
    """Points in and around V in heights above a plane, and the rays that they were seen by.

    Attributes:
        points: (n, 3) in the world, metres.
        volume: V.
        slope: of the plane.
        tops: (k, 3) x, y and height of pieces of surface as large as a cell, with headroom: only
            what lies around these is surface.
        cell_size: metres.
        noise: standard deviation of the points before they were smoothed, metres.
        sights: what sensors at known places measured, not smoothed.
    """

    points: npt.NDArray[np.floating]
    volume: TargetVolume
    slope: Slope
    tops: Array
    cell_size: float
    noise: float
    sights: Sequence[View] = ()

    @cached_property
    def _rays(self) -> list[_Sight]:
        return [_Sight(view, self.slope) for view in self.sights]

    def points_at(
        self, height: float, reach: float, band: float, rise: float
    ) -> tuple[Array, Array, int]:
        """x, y and heights (n, 3) of the points no more than `band` from a height, in the columns
        of tops no more than `reach` from it and in those beside; x and y (m, 2) of what rises,
        above the height `rise` by up to `STEP_M`, wherever; how many such tops there are, and if
        none, no points."""
        near = self.tops[np.abs(self.tops[:, 2] - height) <= reach, :2]
        if len(near) == 0:
            return np.zeros((0, 3)), np.zeros((0, 2)), 0
        # their columns of cells, and those beside; none at the rim
        corner = near.min(axis=0) - 2.0 * self.cell_size
        cells = ((near - corner) / self.cell_size).astype(np.int64)
        columns = np.zeros(cells.max(axis=0) + 3, np.bool_)
        columns[tuple(cells.T)] = True
        columns = _spread(columns, 1)
        places, heights = self._about
        top = rise + STEP_M + SINGLE_ROUNDING
        rows = np.flatnonzero((heights > height - band) & (heights <= top))
        limits = np.array([*corner, 1.0 / self.cell_size, height + band, rise], np.float32)
        return *_points_in_columns(places, heights, rows, columns, limits), len(near)

    @cached_property
    def _about(self) -> tuple[Field, Field]:
        """(2, n) x and y of the points about V, and their heights (n,)."""
        places = np.asarray(self.points.T, np.float32, order="C")
        heights = places[2] - self.slope[0] * places[0] - self.slope[1] * places[1]
        corners = self.volume.lower[:2] - AROUND_M, self.volume.upper[:2] + AROUND_M
        rows = np.flatnonzero(within(places[:2].T, *corners))
        return places[:2].take(rows, axis=1), heights.take(rows)

    def rays(self, height: float, band: float) -> tuple[Array, Array, Array]:
        """(n, 2) where rays ended within the band about a height, and (m, 2) where those that ended
        well below passed it; (k, 2) where those did that ended below the band at all."""
        below = height - STEP_M - PASSED_NOISES * self.noise
        none = np.zeros((0, 2))
        ended = [sight.ended(height - band, height + band) for sight in self._rays]
        passed, crossed = (
            [sight.passed(height, end) for sight in self._rays] for end in (below, height - band)
        )
        return (
            np.concatenate([none, *ended]),
            np.concatenate([none, *passed]),
            np.concatenate([none, *crossed]),
        )


@njit(cache=True, nogil=True)
def _points_in_columns(
    places: Field, heights: Field, rows: Index, columns: Mask, limits: Field
) -> tuple[Array, Array]:
    """Of the points of those rows (k,) x, y and height (n, 3) of those in columns of cells (nx, ny)
    up to a height, and x and y (m, 2) of those above another.

    Args:
        places, heights: (2, p) and (p,), metres.
        limits: (5,) x and y where the columns begin, columns a metre, and the two heights.
    """
    nx, ny = columns.shape
    x0, y0, per_metre, highest, rise = limits
    on, over = np.empty((len(rows), 3)), np.empty((len(rows), 2))
    n = m = 0
    for row in rows:
        x, y, z = places[0, row], places[1, row], heights[row]
        if z > rise:
            over[m, 0], over[m, 1] = x, y
            m += 1
        # its column, those at the rim beyond it
        i = int(min(max((x - x0) * per_metre, 0.0), nx - 1.0))
        j = int(min(max((y - y0) * per_metre, 0.0), ny - 1.0))
        if z <= highest and columns[i, j]:
            on[n, 0], on[n, 1], on[n, 2] = x, y, z
            n += 1
    return on[:n], over[:m]


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


def _spread(image: _AnyImage, reach: int) -> _AnyImage:
    """(nx, ny) the greatest value within the square of so many pixels to each side."""
    for axis in range(2):
        done = 0
        while done < reach:
            # what is known of 2 done + 1 pixels is so of three times as many
            step = min(2 * done + 1, reach - done)
            known, image = image.swapaxes(0, axis), image.copy()
            along = image.swapaxes(0, axis)
            np.maximum(along[step:], known[:-step], out=along[step:])
            np.maximum(along[:-step], known[step:], out=along[:-step])
            done += step
    return image


def _with_corners(gap: Field, narrow: float) -> Field:
    """Discs of gaps, those of holes grown so that they reach into their corners.

    What discs leave closed of a corner between two wires is deep by `CORNER` times their radius,
    which of wide holes counts as that of a disc of `narrow`. What reaches the rim of the
    raster is no hole.
    """
    # gaps that do not reach the rim of the raster are holes
    labels, _ = label(gap > 0.0, structure=np.ones((3, 3)))
    hole = np.arange(labels.max() + 1) > 0
    for rim in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        hole[rim] = False
    deep = np.float32(CORNER) * np.minimum(gap, np.float32(narrow))
    return np.where(hole.take(labels), gap + deep, gap)


class HeldPixels(NamedTuple):
    """The pixels of a raster in which points are.

    Attributes:
        pixels: (m,) numbered row by row.
        number: (m,) points in each.
        means: (m, 2) their mean position, pixels.
        total, highest: (m,) sum and greatest of their last column.
        of_point: (n,) which of these each point is in, or -1.
    """

    pixels: Index
    number: Array
    means: Array
    total: Array
    highest: Array
    of_point: Index


class Raster:
    """A grid of pixels around points, which are in metres until `held` has them in pixels.

    Args:
        low, high: (2,) corners of the points, m.
        pixel: side of a pixel, metres.
        rim: m around the points.
    """

    def __init__(self, low: Array, high: Array, pixel: float, rim: float) -> None:
        self.pixel = pixel
        self.origin = low - rim
        shape = np.ceil((high + rim - self.origin) / pixel).astype(int) + 1
        self.shape = (int(shape[0]), int(shape[1]))

    def held(self, points: Array) -> HeldPixels:
        """Where points (n, 2 or 3), m, are."""
        pixels, sums, of_point = pixel_sums(points, self.origin, self.pixel, self.shape)
        means = (sums[:, 1:3] / sums[:, :1] - self.origin) / self.pixel
        return HeldPixels(pixels, sums[:, 0], means, sums[:, -2], sums[:, -1], of_point)

    def image(
        self, pixels: Index, values: npt.ArrayLike, empty: npt.ArrayLike = 0.0
    ) -> npt.NDArray:
        """(nx, ny) the values (m,) of pixels, and what the others have, of whose kind all are."""
        image = np.full(self.shape, empty)
        image.reshape(-1)[pixels] = values
        return image

    def images(self, pixels: Index, values: Sequence[Array | Index]) -> Array:
        """(k, nx, ny) k values (m,) of the pixels, and 0 in the others."""
        images = np.zeros((len(values), *self.shape))
        for image, each in zip(images.reshape(len(values), -1), values, strict=True):
            image[pixels] = each
        return images

    def width(self, side: float) -> int:
        """Pixels, an odd number, along a square of that side, metres, or a little less."""
        return 2 * int(0.5 * side / self.pixel) + 1

    def nearest(self, discs: Array) -> tuple[Field, Index32]:
        """(nx, ny) pixels to the nearest of points (n, 2), or of discs (n, 3) of those middles and
        radii, negative within; and which that is, or -1."""
        near = np.full(self.shape, np.float32(sum(self.shape)))
        who = np.full(self.shape, np.int32(-1))
        elements = np.zeros((len(discs), 4))
        elements[:, :2] = discs[:, :2]
        if discs.shape[1] > 2:
            elements[:, 3] = discs[:, 2]
        hand_on_nearest(elements, np.arange(len(discs)), near, who)
        return near, who


def make_layers(
    cloud: SlopeCloud, heights: Sequence[float], tolerance: float
) -> list[Layer | None]:
    """The layer at each height; None where nothing was measured there.

    Args:
        tolerance: m by which what carries may be above or below.
    """
    return [_make_layer(cloud, height, tolerance) for height in heights]


def _make_layer(cloud: SlopeCloud, height: float, tolerance: float) -> Layer | None:
    step("making the layer of a surface")
    noise = cloud.noise
    # how far off the height points may be, and tops, with the noise that is left in them
    band = tolerance + 0.5 * LAYER_STEP_M + noise
    reach = tolerance + 0.5 * LAYER_STEP_M + 0.5 * noise
    # the points there, and what rises above the band
    on, over, tops = cloud.points_at(height, reach, band, height + max(band, STEP_M))
    if len(on) == 0:
        return None
    # about how far points are apart, and pixels that suit that
    spacing = cloud.cell_size * math.sqrt(tops / len(on))
    heights = on[:, 2].copy()
    low, high = (np.array([of(on[:, 0]), of(on[:, 1])]) for of in (np.min, np.max))
    pixel = PIXEL_M[1] if noise > 0.0 else _pixel_side(spacing, high - low)
    raster = Raster(low, high, pixel, WIDEST_M + 2.0 * PIXEL_M[1])
    measured, things = raster.held(on), raster.held(over)
    # what was measured about what rises is its foot
    foot = max(1, round((spacing + noise) / pixel))
    risen = _spread(raster.image(things.pixels, True, np.False_), foot)
    to_point, who = raster.nearest(np.vstack([measured.means, things.means]))
    of_foot = risen.take(measured.pixels)
    of_thing = np.append(of_foot, np.ones(len(things.pixels), np.bool_)).take(who)
    widest = widest_empty_disc(to_point, WIDEST_M / pixel + 1.0)
    chance = _chance_radius(raster, widest, measured)
    rays, whole = _seen_through(raster, to_point, *cloud.rays(height, band))
    hole = HOLE_M / pixel
    radius = np.where(whole, chance, np.minimum(chance, np.float32(hole)))
    closed = widest <= chance
    lost = closed & ~whole & (widest > hole)
    sparse = float(lost.sum()) / max(int(closed.sum()), 1)
    # gaps that are wider than chance explains, as discs around their pixels
    gap = _with_corners(np.where(to_point > radius, to_point, np.float32(0.0)), hole)
    gaps = (widest > radius) | (gap > 0.0)
    i, j = (rays[:, :2] + 0.5).astype(np.int64).T
    gaps[i, j] = True
    # gaps behind things are no ends, and carry nothing, nor do the pixels beside them
    from_end = _from_discs(raster, np.where(of_thing, np.float32(0.0), gap), rays[~of_thing[i, j]])
    beside = _spread(gaps & of_thing, math.ceil(CORNER * hole))
    inside = np.where(beside, np.minimum(from_end, np.float32(-1.0)), from_end)
    sampled = radius.reshape(-1)[:: max(1, radius.size // SAMPLES)]
    averaged = TILE_M if noise > 0.0 else float(np.median(sampled)) * pixel
    # of the points, those of the surface's top, and none of things' feet if there are others
    top = raster.image(measured.pixels, measured.highest, np.float32(-np.inf))
    least = _spread(top, 1).take(measured.pixels) - 0.5 * tolerance - 2.0 * noise
    upper = heights >= least.take(measured.of_point)
    beside_things = upper & ~of_foot.take(measured.of_point)
    rows = np.flatnonzero(beside_things if beside_things.any() else upper)
    of_pixel, off = measured.of_point.take(rows), heights.take(rows) - height
    powers = (None, off, off**2) if noise > 0.0 else (None, off)
    sums = [np.bincount(of_pixel, power, len(measured.pixels)) for power in powers]
    # within the widest disc, and beyond things' feet, something was measured
    far = 2 * (math.ceil(float(radius.max())) + foot) + 1
    widths = raster.width(averaged), far
    images = raster.images(measured.pixels, sums)
    surface = _surface_heights(images, noise, widths, inside > -2.0)
    return Layer(
        height,
        raster.origin,
        pixel,
        inside * np.float32(pixel),
        from_end * np.float32(pixel),
        surface + np.float32(height),
        _highest_points(raster, measured, top, noise),
        risen,
        sparse,
    )


def _pixel_side(spacing: float, sides: Array) -> float:
    """m: about half of what the points are apart, coarser where the layer is large."""
    area = float((sides + 2.0 * WIDEST_M).prod())
    return float(np.clip(max(0.5 * spacing, np.sqrt(area / MOST_PIXELS)), *PIXEL_M))


def _chance_radius(raster: Raster, widest: Field, measured: HeldPixels) -> Field:
    """(nx, ny) pixels, the widest disc without points that chance may explain.

    Args:
        widest: (nx, ny) pixels, the widest that covers each pixel.
        measured: the points.
    """
    pixel, least, most = raster.pixel, NARROWEST_M, WIDEST_M
    side = max(1, round(TILE_M / pixel))
    (nx, ny), tiles = widest.shape, tuple(-(-n // side) for n in widest.shape)
    apart = 3  # radii that are tried from one look to the next
    steps = math.ceil(apart * math.log(most / least) / math.log(GROWTH)) + 1
    # a pixel is as wide as what holds one point by itself
    radii = max(least / WIDEST, pixel) * GROWTH ** (np.arange(steps + apart) / apart)
    # closed area of each tile and those around it, up to each radius
    step = np.log(np.maximum(widest * np.float32(pixel / radii[0]), np.float32(1.0)))
    step = np.ceil(step * np.float32(apart / math.log(GROWTH)) - np.float32(SINGLE_ROUNDING))
    step = np.minimum(step.astype(np.int64), len(radii))
    tile = np.add.outer(np.arange(nx) // side * tiles[1], np.arange(ny) // side).ravel()
    slots = (len(radii) + 1, *tiles)
    sizes = np.bincount(step.ravel() * math.prod(tiles) + tile, minlength=math.prod(slots))
    discs = sizes.reshape(slots)[:-1].astype(np.float64)
    closed = window_sums(discs, 3).cumsum(axis=0) * pixel**2
    # and how many points there are
    tile_of = tile.take(measured.pixels)
    held = np.bincount(tile_of, weights=measured.number, minlength=math.prod(tiles))
    number = window_sums(held.reshape(1, *tiles).astype(np.float64), 3)[0]
    now, later = closed[:-apart], closed[apart:]
    least_area = AREA_PER_POINT * np.multiply.outer(radii[: len(now)] ** 2, number)
    stays = (later <= GROWTH * now) & (now >= least_area)
    first = np.where(stays.any(axis=0), stays.argmax(axis=0), len(now) - 1)
    found = np.where(number >= SURE_COUNT, radii[first] * WIDEST, least)
    found = np.clip(found, least, most)
    found = np.repeat(np.repeat(found / pixel, side, axis=0), side, axis=1)
    return found[:nx, :ny].astype(np.float32)


def _seen_through(
    raster: Raster, to_point: Field, ended: Array, passed: Array, crossed: Array
) -> tuple[Array, Mask]:
    """Discs (n, 3), pixels, that rays open which passed the layer; (nx, ny) whether rays tell that
    the surface about a pixel has no holes of some share, as hardly one ended below it."""
    if not len(passed):
        return np.zeros((0, 3)), np.zeros(raster.shape, np.bool_)
    # a ray opens half of the way to the nearest point, and the four pixels around it at least
    rays = raster.held(passed).means
    away = map_coordinates(to_point, rays.T, order=1, mode="nearest")
    discs = np.column_stack([rays, np.maximum(0.5 * away, np.minimum(away, 0.75))])
    # a sensor that saw nothing below tells nothing of holes
    ends = raster.held(ended if len(passed) >= SURE_COUNT else ended[:0])
    images = [raster.image(each.pixels, each.number) for each in (ends, raster.held(crossed))]
    on, through = window_sums(np.stack(images), raster.width(3.0 * TILE_M))
    return discs, np.asarray(on > SURE_COUNT * (through + 1.0) - 0.5)


def _from_discs(raster: Raster, radius: Field, rays: Array) -> Field:
    """(nx, ny) pixels to the nearest of some discs, negative within.

    Args:
        radius: (nx, ny) of the discs around pixels, 0 where there are none.
        rays: (k, 3) middles and radii of others, pixels.
    """
    # where discs are wider than any that chance explains the rim alone counts, and within that the
    # discs' own depth
    wide = np.float32((WIDEST_M + CORNER * HOLE_M) / raster.pixel + 1.0)
    at = np.flatnonzero((radius > 0.0) & _spread(radius < wide, 1))
    discs = [*np.divmod(at, raster.shape[1]), np.minimum(radius.take(at), wide)]
    near = raster.nearest(np.vstack([np.column_stack(discs), rays]))[0]
    return np.where(radius > 0.0, np.minimum(near, -radius), near)


def _surface_heights(images: Array, noise: float, widths: tuple[int, int], needed: Mask) -> Field:
    """(nx, ny) m, heights of the surface; inf far from all points.

    Args:
        images: (2 or, with noise, 3, nx, ny) how many points each pixel has, and the sums of their
            heights and squares.
        widths: pixels along the squares over which heights are averaged, the second where the
            first hold no point.
        needed: (nx, ny) where heights are asked for.
    """
    surface = np.full(images.shape[1:], np.inf)
    count, total, *squares = window_sums(images, widths[0])
    held = count > 0.5
    np.divide(total, count, out=surface, where=held)
    if noise > 0.0:  # between two levels there is no surface
        many = np.maximum(count, 1.0)
        surface[held & (squares[0] / many - (total / many) ** 2 > noise**2)] = np.inf
    if (needed & ~held).any():
        count, total = window_sums(images[:2], widths[1])
        np.divide(total, count, out=surface, where=~held & (count > 0.5))
    return surface.astype(np.float32)


def _highest_points(raster: Raster, measured: HeldPixels, top: Array, noise: float) -> Field:
    """(nx, ny) m, the highest point under what touches there, of the highest in each pixel."""
    if noise > 0.0:  # single points say nothing
        images = raster.images(measured.pixels, (measured.number, measured.total))
        many, total = window_sums(images, raster.width(TOP_WINDOW_M))
        top = np.where(many > FEWEST_ON_TOP - 0.5, total / np.maximum(many, 1.0), -np.inf)
    # what lies within a coarse pixel beside a point that touches is under the object
    return _spread(top.astype(np.float32), math.ceil(PIXEL_M[1] / raster.pixel))
