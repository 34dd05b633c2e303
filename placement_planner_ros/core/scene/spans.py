"""Spans: where the centre of mass of an object may be that stands on several pieces of surface.

An object that lies across a gap has its centre of mass above the gap, and perhaps no vertex of its
face on any surface. It lies within the convex hull of what carries it, though, and no two places
that do are farther apart than the object is wide. So the surfaces of one height are gathered that
are that near to each other; their hulls hold the feet of all centres of mass.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.ndimage import label, maximum_filter
from scipy.spatial import ConvexHull

from placement_planner_ros.core.boxes import disjoint_rectangles
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.layers import Layer
from placement_planner_ros.core.scene.regions import (
    Region,
    RegionSettings,
    largest_regions,
    mask_tiles,
)
from placement_planner_ros.core.types import LEVEL, Array, Index, Slope, TargetVolume, upright


class Footprint(NamedTuple):
    """What an object needs under it.

    Attributes:
        radius: m from the foot of its centre of mass to the farthest contact point, on any face.
        margin: m from there to the end of what carries it, at least.
        heights: m, least and greatest of the centre of mass above a face.
    """

    radius: float
    margin: float
    heights: tuple[float, float]


class _Patches(NamedTuple):
    """Squares of a layer in which something carries."""

    corner: Array
    """(2,) m, lower corner of the square (0, 0)."""
    size: float
    """m."""
    cells: Index
    """(n, 2) which squares."""
    height: Array
    """(n,) m, of their surface."""
    plane: float
    """m, the height that most of the layer's surface lies at."""


def spans(environment: Environment, footprint: Footprint, tolerance: float) -> tuple[Region, ...]:
    """As regions: where the feet of the centre of mass may be, on planes in which surface lies.

    The plane's height is that of the surfaces around each of the tiles that a span is cut into.
    Surfaces outside V carry, too; the feet lie in V. They are those along the normal of the plane,
    which slopes shift against those along gravity.

    Args:
        tolerance: m that what carries may be off the plane.
    """
    settings = RegionSettings()
    found: list[Region] = []
    for slope in (LEVEL, *(each.slope for each in environment.inclines)):
        support = environment.support_of(slope)
        beside = 2.0 * footprint.radius
        for height in support.heights(environment.volume, beside, settings.height_tolerance):
            layer = support.layer(height, tolerance)
            if layer is None:
                continue
            patches = _layer_patches(layer, environment.measured.cell_size, height, tolerance)
            for hull, members in _patch_hulls(patches, slope, footprint):
                found += _hull_regions(
                    patches, slope, hull, members, footprint, environment.volume, settings
                )
    return largest_regions(found, settings)


def _layer_patches(layer: Layer, cell_size: float, height: float, tolerance: float) -> _Patches:
    """What of a layer carries, in squares of about a cell."""
    side = max(1, round(cell_size / layer.pixel))
    shape = [-(-n // side) for n in layer.inside.shape]
    carries = (layer.inside >= 0.0) & (np.abs(layer.surface - height) <= tolerance)
    at = np.argwhere(carries)
    square = at[:, 0] // side * shape[1] + at[:, 1] // side
    count = np.bincount(square, minlength=shape[0] * shape[1])
    held = np.flatnonzero(count)
    total = np.bincount(square, weights=layer.surface[carries], minlength=len(count))
    cells = np.column_stack(np.divmod(held, shape[1])).astype(np.int64)
    size = side * layer.pixel
    corner = layer.origin - 0.5 * layer.pixel
    return _Patches(corner, size, cells, total[held] / count[held], height)


def _patch_hulls(
    patches: _Patches, slope: Slope, footprint: Footprint
) -> Iterator[tuple[Array, Index]]:
    """The hull of each group of patches that one object may stand on, as lines (k, 3), a point x, y
    within where a x + b y + c <= 0 for each, and the rows of those in it."""
    size, cells = patches.size, patches.cells
    if not len(cells):
        return
    reach = int(np.ceil(footprint.radius / size)) + 1
    low = cells.min(axis=0) - reach
    shape = cells.max(axis=0) - low + reach + 1
    filled = np.zeros(shape, dtype=np.bool_)
    filled[tuple((cells - low).T)] = True
    groups, count = label(maximum_filter(filled, 2 * reach + 1), np.ones((3, 3)))
    of_rows = groups[tuple((cells - low).T)]
    for group in range(1, count + 1):
        members = np.flatnonzero(of_rows == group)
        lower = patches.corner + cells[members] * size
        corners = np.concatenate([lower + size * np.array(c) for c in np.ndindex(2, 2)])
        if (np.ptp(corners, axis=0) < 2.0 * footprint.margin).any():
            continue
        # along the normal of the plane the foot lies elsewhere than along gravity
        shift = upright(slope)[:2, 2]
        corners = np.concatenate([corners - each * shift for each in {0.0, *footprint.heights}])
        yield ConvexHull(corners).equations, members


def _hull_regions(
    patches: _Patches,
    slope: Slope,
    hull: Array,
    members: Index,
    footprint: Footprint,
    volume: TargetVolume,
    settings: RegionSettings,
) -> Iterator[Region]:
    """Squares that a hull reaches into, in V, in tiles, each at the height of what is around it."""
    size, flat = patches.size, disjoint_rectangles(volume.boxes[:, :, :2])
    first = np.floor((flat[:, 0].min(axis=0) - patches.corner) / size)
    last = np.ceil((flat[:, 1].max(axis=0) - patches.corner) / size)
    origin = patches.corner + (first + 0.5) * size
    squares = origin + np.moveaxis(np.indices((last - first).astype(int)), 0, 2) * size
    # the corner of each square that is farthest within each line of the hull
    mask = np.ones(squares.shape[:2], np.bool_)
    for *normal, offset in hull:
        mask &= squares @ normal + offset <= 0.5 * size * np.abs(normal).sum()
    lower, height = patches.corner + patches.cells[members] * size, patches.height[members]
    near_plane = np.abs(height - patches.plane) <= settings.height_tolerance
    for _, _, rectangles in mask_tiles(mask, origin, size, settings):
        low = rectangles[:, :2].min(axis=0) - footprint.radius
        high = rectangles[:, 2:].max(axis=0) + footprint.radius
        near = ((lower + size >= low) & (lower <= high)).all(axis=1) & near_plane
        z = float(np.median(height[near])) if near.any() else patches.plane
        section = volume.section(z) if slope == LEVEL else flat
        region = Region(rectangles, z, slope=slope).within(section)
        if region is not None:
            yield region
