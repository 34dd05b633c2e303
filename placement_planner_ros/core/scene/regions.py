"""R, the placement regions: contiguous surface in one plane, level or sloping."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import find_objects, label

from placement_planner_ros.core.boxes import disjoint_rectangles
from placement_planner_ros.core.scene.layers import Layer
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.types import (
    LEVEL,
    Array,
    Index,
    Mask,
    Slope,
    TargetVolume,
    frozen_array,
)


@dataclass(frozen=True, slots=True)
class RegionSettings(Settings):
    """What counts as a placement region.

    Attributes:
        headroom: free height above a surface for it to support anything.
        max_slope: see its words.
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
        slope: of the plane.
        areas: (k,) of the rectangles, m².
        share: (k,) their running sum, m².
    """

    rectangles: Array
    z: float
    slope: Slope = LEVEL
    areas: Array = field(init=False)
    share: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        rectangles = frozen_array(self.rectangles, (-1, 4))
        areas = (rectangles[:, 2] - rectangles[:, 0]) * (rectangles[:, 3] - rectangles[:, 1])
        object.__setattr__(self, "rectangles", rectangles)
        object.__setattr__(self, "areas", frozen_array(areas))
        object.__setattr__(self, "share", frozen_array(areas.cumsum()))

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
        lower = np.maximum(self.rectangles[:, None, :2], section[:, 0])
        upper = np.minimum(self.rectangles[:, None, 2:], section[:, 1])
        parts = np.concatenate([lower, upper], axis=2).reshape(-1, 4)
        width, depth = parts[:, 2] - parts[:, 0], parts[:, 3] - parts[:, 1]
        parts = parts[np.minimum(width, depth) > 1e-9]  # m: what rounding leaves
        return Region(parts, self.z, self.slope) if len(parts) else None

    def split(self) -> tuple[Region, ...]:
        """Up to four regions, cut at the area-weighted mean x and y (the paper's children of r).

        The parts cover this region exactly and may be split further, down to any size.
        """
        middles = 0.5 * (self.rectangles[:, :2] + self.rectangles[:, 2:])
        mean = (self.areas / self.areas.sum()) @ middles
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
        """(3,) a point on the region, uniform by area."""
        return RegionPoints([self]).sample(np.zeros(1, np.int64), rng)[0]


class RegionPoints:
    """`Region.sample` for any of several regions.

    Attributes:
        slopes: (regions, 2) of each.
    """

    def __init__(self, regions: Sequence[Region]) -> None:
        self._rectangles = np.concatenate([np.zeros((0, 4)), *(r.rectangles for r in regions)])
        self._z = np.array([region.z for region in regions])
        self.slopes = np.array([region.slope for region in regions]).reshape(-1, 2)
        # of region k, from k to k + 1: how far its rectangles reach in the share of its surface
        ends = [k + region.share / region.share[-1] for k, region in enumerate(regions)]
        self._ends = np.concatenate([np.zeros(0), *ends])
        self._last = np.cumsum([len(end) for end in ends]) - 1

    def sample(self, picked: Index, rng: np.random.Generator) -> Array:
        """(n, 3) a point on each of the regions picked (n,), uniform by area."""
        pick, across, along = rng.random((3, len(picked)))
        # a rectangle of the region picked, then a place in it
        row = np.minimum(self._ends.searchsorted(picked + pick, "right"), self._last[picked])
        x0, y0, x1, y1 = self._rectangles[row].T
        points = np.empty((len(picked), 3))
        points[:, 0], points[:, 1] = x0 + across * (x1 - x0), y0 + along * (y1 - y0)
        points[:, 2] = self._z[picked] + (points[:, :2] * self.slopes[picked]).sum(axis=1)
        return points


def regions_of_layers(
    layers: Mapping[float, Layer],
    trim: float,
    slope: Slope,
    volume: TargetVolume,
    settings: RegionSettings,
) -> tuple[Region, ...]:
    """What of layers lies in V, larger first: pieces of surface of 8-connected pixels, in tiles.

    Each is cut into tiles of `max_side` and clipped to V. Its z is the median of its pixels', which
    differ from the layer's height by the height tolerance at most.

    Args:
        layers: by the heights of surfaces.
        trim: m to be kept from where the surface ends.
    """
    found: list[Region] = []
    for height, layer in layers.items():
        found += _regions_of_layer(layer, height, trim, slope, volume, settings)
    return largest_regions(found, settings)


def _regions_of_layer(
    layer: Layer,
    height: float,
    trim: float,
    slope: Slope,
    volume: TargetVolume,
    settings: RegionSettings,
) -> list[Region]:
    # of what lies around V
    footprint = volume.boxes[:, :, :2]
    around = _pixels_over(layer, footprint[:, 0].min(axis=0), footprint[:, 1].max(axis=0))
    layer = _cropped(layer, around)
    # surface at that height, away from its ends and from what rises
    level = np.abs(layer.surface - height) <= settings.height_tolerance
    mask = (layer.inside >= 0.0) & (layer.from_end >= trim) & level & ~layer.risen
    over = np.zeros(mask.shape, np.bool_)
    for lower, upper in footprint:
        over[_pixels_over(layer, lower, upper)] = True
    mask &= over
    # what slopes may lie in V in part
    flat = None if slope == LEVEL else disjoint_rectangles(footprint)
    regions = []
    for tile, own, rectangles in mask_tiles(mask, layer.origin, layer.pixel, settings):
        z = float(np.median(layer.surface[tile][own]))
        section = volume.section(z) if flat is None else flat
        region = Region(rectangles, z, slope).within(section)
        if region is not None and region.area >= settings.min_area:
            regions.append(region)
    return regions


Tile = tuple[slice, slice]


def _pixels_over(layer: Layer, lower: Array, upper: Array) -> Tile:
    """The pixels that touch a rectangle of corners (2,), m."""
    first, last = (
        np.floor((end - layer.origin) / layer.pixel + 0.5).astype(int) for end in (lower, upper)
    )
    i, j = (slice(max(a, 0), max(b + 1, 0)) for a, b in zip(first, last, strict=True))
    return i, j


def _cropped(layer: Layer, tile: Tile) -> Layer:
    """That part of it."""
    origin = layer.origin + np.array([along.start for along in tile]) * layer.pixel
    fields = ("inside", "from_end", "surface", "top", "risen")
    return layer._replace(origin=origin, **{name: getattr(layer, name)[tile] for name in fields})


def mask_tiles(
    mask: Mask, origin: Array, pixel: float, settings: RegionSettings
) -> Iterator[tuple[Tile, Mask, Array]]:
    """The 8-connected pieces of a mask (nx, ny), in tiles of `max_side`.

    Args:
        origin: (2,) centre of the first pixel, metres.
        pixel: side, metres.

    Yields:
        Where in the mask, which pixels there, and the disjoint rectangles (k, 4), m, that they are.
    """
    if not mask.any():  # nor does scipy take an empty one
        return
    labels, number = label(mask, np.ones((3, 3)))
    fewest = settings.min_area / pixel**2
    large = np.bincount(labels.ravel(), minlength=number + 1) >= fewest
    for piece, bounds in enumerate(find_objects(labels, number), 1):
        if not large[piece]:
            continue
        tiles = list(_tiles_of(bounds, settings.max_side / pixel))
        for tile in tiles:
            of_tile, parts = labels[tile] == piece, 1
            # a tile may cut a piece into several parts
            if len(tiles) > 1:
                of_tile, parts = label(of_tile, np.ones((3, 3)))
            corner = origin + (np.array([tile[0].start, tile[1].start]) - 0.5) * pixel
            for part in range(1, parts + 1):
                own = of_tile == part
                if own.sum() >= fewest:
                    rectangles = corner + _mask_rectangles(own).reshape(-1, 2, 2) * pixel
                    yield tile, own, rectangles.reshape(-1, 4)


def _tiles_of(bounds: Tile, side: float) -> Iterator[Tile]:
    """Tiles of no more than that many pixels along each side that bounds are cut into evenly."""
    ends = []
    for along in bounds:
        number = int(np.ceil((along.stop - along.start) / max(1.0, np.floor(side))))
        ends.append(np.linspace(along.start, along.stop, number + 1).round().astype(int))
    for i0, i1 in itertools.pairwise(ends[0]):
        for j0, j1 in itertools.pairwise(ends[1]):
            yield slice(int(i0), int(i1)), slice(int(j0), int(j1))


def _mask_rectangles(mask: Mask) -> Index:
    """(k, 4) pixels at which disjoint rectangles begin and end, along x and y, that a mask is made
    up of; rows that are alike are joined."""
    rows = np.flatnonzero(np.append(True, (mask[1:] != mask[:-1]).any(axis=1)))
    last = np.append(rows[1:], len(mask))
    # where runs of pixels begin and end in each of these rows, in the same order
    steps = np.zeros((len(rows), mask.shape[1] + 1), np.int8)
    steps[:, :-1] = mask[rows]
    steps[:, 1:] -= mask[rows]
    (row, low), high = np.nonzero(steps > 0), np.nonzero(steps < 0)[1]
    return np.column_stack([rows[row], low, last[row], high])


def largest_regions(regions: Iterable[Region], settings: RegionSettings) -> tuple[Region, ...]:
    """As many as are kept, larger first."""
    ordered = sorted(regions, key=lambda region: -region.area)
    return tuple(ordered[: settings.max_regions])
