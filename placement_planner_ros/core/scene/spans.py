"""Spans: where the centre of mass of an object may be that stands on several pieces of surface.

An object that lies across a gap has its centre of mass above the gap, and perhaps no vertex of its
face on any surface. It lies within the convex hull of what carries it, though, and no two places
that do are farther apart than the object is wide. So the surfaces of one height are gathered that
are that near to each other; their hulls hold the feet of all centres of mass.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import label, maximum_filter
from scipy.spatial import ConvexHull

from placement_planner_ros.core.boxes import disjoint_rectangles
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.regions import Region, RegionSettings, largest
from placement_planner_ros.core.scene.support import SupportMap
from placement_planner_ros.core.types import LEVEL, Array, TargetVolume, upright

Index = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

_LAYERS = 64
"""Heights at most at which surfaces are gathered."""
_SAME = 1e-9
"""m by which strips of one rectangle may differ."""


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


class _Layer(NamedTuple):
    """Surfaces of one height.

    Attributes:
        height: m, above a plane through the origin.
        rows: of the support map's surfaces, those at that height that make the layer.
        near: those that may carry together with them.
    """

    height: float
    rows: Index
    near: Index


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
        rows = _around(support, environment.volume, 2.0 * footprint.radius)
        if slope != LEVEL:  # of what is too small to be known to slope, only what lies in its plane
            known = np.array([r.z for r in environment.regions if r.slope == slope])
            off = np.abs(support.height[rows, None] - known).min(axis=1, initial=np.inf)
            rows = rows[off <= settings.height_tolerance]
        for layer in _layers(support, rows, settings.height_tolerance, tolerance):
            for hull, members in _hulls(support, layer, footprint):
                found += _tiles(support, hull, members, footprint, environment.volume, settings)
    return largest(found, settings)


def _around(support: SupportMap, volume: TargetVolume, reach: float) -> Index:
    """Surfaces at heights of V that are no farther from it than that, seen from above."""
    rectangle = support.rectangle
    middle = 0.5 * (rectangle[:, :2] + rectangle[:, 2:])
    near = np.zeros(len(middle), np.bool_)
    for lower, upper in volume.joined:
        beside = (rectangle[:, 2:] >= lower[:2] - reach) & (rectangle[:, :2] <= upper[:2] + reach)
        # of a plane that slopes, what lies within V at the place that is nearest
        at = np.clip(middle, lower[:2], upper[:2])
        z = support.height + at @ np.array(support.slope)
        near |= beside.all(axis=1) & (z >= lower[2]) & (z <= upper[2])
    return np.flatnonzero(near)


def _layers(
    support: SupportMap, rows: Index, thickness: float, tolerance: float
) -> Iterator[_Layer]:
    """Of those surfaces, groups that differ in height by no more than twice the thickness, those
    of most surfaces first."""
    height = support.height
    left = rows[np.argsort(height[rows], kind="stable")]
    for _ in range(_LAYERS):
        if len(left) == 0:
            return
        at = height[left]
        last = np.searchsorted(at, at + 2.0 * thickness, side="right")
        first = int(np.argmax(last - np.arange(len(at))))
        middle = float(np.median(at[first : last[first]]))
        taken = np.abs(at - middle) <= thickness
        reach = tolerance + thickness
        yield _Layer(middle, left[taken], np.flatnonzero(np.abs(height - middle) <= reach))
        left = left[~taken]


def _hulls(
    support: SupportMap, layer: _Layer, footprint: Footprint
) -> Iterator[tuple[Array, Index]]:
    """Corners (k, 2) of the hull of each group of surfaces that one object may stand on, and the
    rows of the layer's surfaces in it."""
    size = support.cell_size
    cells = _cells(support, layer.rows)
    reach = int(np.ceil(footprint.radius / size)) + 1
    low = cells.min(axis=0) - reach
    shape = cells.max(axis=0) - low + reach + 1
    filled = np.zeros(shape, dtype=np.bool_)
    filled[tuple((cells - low).T)] = True
    groups, count = label(maximum_filter(filled, 2 * reach + 1), np.ones((3, 3)))
    of_rows = groups[tuple((cells - low).T)]
    around = _cells(support, layer.near) - low
    within = ((around >= 0) & (around < shape)).all(axis=1)
    around = around[within]
    of_near = groups[tuple(around.T)]
    for group in range(1, count + 1):
        members = (around[of_near == group] + low) * size + support.origin[:2]
        corners = np.concatenate([members + size * np.array(c) for c in np.ndindex(2, 2)])
        if (np.ptp(corners, axis=0) < 2.0 * footprint.margin).any():
            continue
        # along the normal of the plane the foot lies elsewhere than along gravity
        shift = upright(support.slope)[:2, 2]
        shifted = [corners - each * shift for each in {0.0, *footprint.heights}]
        corners = np.concatenate(shifted)
        yield corners[ConvexHull(corners).vertices], layer.rows[of_rows == group]


def _tiles(
    support: SupportMap,
    hull: Array,
    members: Index,
    footprint: Footprint,
    volume: TargetVolume,
    settings: RegionSettings,
) -> Iterator[Region]:
    """A hull within V, cut into tiles of bounded size, each at the height of what is around it."""
    low, high = hull.min(axis=0), hull.max(axis=0)
    flat = disjoint_rectangles(volume.joined[:, :, :2])
    clipped_low = np.maximum(low, volume.lower[:2])
    clipped_high = np.minimum(high, volume.upper[:2])
    if (clipped_high <= clipped_low).any():
        return
    number = np.ceil((clipped_high - clipped_low) / settings.max_side - 1e-9).astype(np.int64)
    x, y = (
        np.linspace(a, b, n + 1) for a, b, n in zip(clipped_low, clipped_high, number, strict=True)
    )
    rectangle, height = support.rectangle[members], support.height[members]
    for i in range(number[0]):
        strips = _strips(hull, x[i], x[i + 1], support.cell_size)
        for j in range(number[1]):
            parts = strips.copy()
            parts[:, 1] = np.maximum(parts[:, 1], y[j])
            parts[:, 3] = np.minimum(parts[:, 3], y[j + 1])
            parts = parts[parts[:, 3] > parts[:, 1]]
            if len(parts) == 0:
                continue
            beside = np.array([x[i], y[j], x[i + 1], y[j + 1]])
            beside += footprint.radius * np.array([-1.0, -1.0, 1.0, 1.0])
            near = (rectangle[:, 2:] >= beside[:2]) & (rectangle[:, :2] <= beside[2:])
            around = height[near.all(axis=1)]
            z = float(np.median(around if len(around) else height))
            section = volume.section(z) if support.slope == LEVEL else flat
            region = Region(parts, z, slope=support.slope).within(section)
            if region is not None:
                yield region


def _strips(hull: Array, begin: float, end: float, width: float) -> Array:
    """(k, 4) rectangles that hold a convex polygon (n, 2), counter-clockwise, from x to x."""
    edges = np.linspace(begin, end, max(1, int(np.ceil((end - begin) / width))) + 1)
    order = np.argsort(hull[:, 0], kind="stable")
    left, right = int(order[0]), int(order[-1])
    corners = np.roll(hull, -left, axis=0)
    at = (right - left) % len(hull)
    below, above = corners[: at + 1], np.vstack([corners[at:], corners[:1]])[::-1]
    strips: list[list[float]] = []
    for x0, x1 in itertools.pairwise(edges):
        lowest, highest = (
            _values(chain, x0, x1, sign) for chain, sign in ((below, -1.0), (above, 1.0))
        )
        same = strips and abs(strips[-1][1] - lowest) + abs(strips[-1][3] - highest) <= _SAME
        if same:
            strips[-1][2] = x1
        else:
            strips.append([x0, lowest, x1, highest])
    return np.array(strips)


def _values(chain: Array, x0: float, x1: float, sign: float) -> float:
    """The greatest (sign 1) or least (-1) y of a chain of points from x0 to x1."""
    inside = chain[(chain[:, 0] >= x0) & (chain[:, 0] <= x1), 1]
    ends = np.interp([x0, x1], chain[:, 0], chain[:, 1])
    return float(sign * np.max(sign * np.concatenate([inside, ends])))


def _cells(support: SupportMap, rows: Index) -> Index:
    """(k, 2) columns of those surfaces."""
    column = np.searchsorted(support.start, rows, side="right") - 1
    return np.column_stack(np.divmod(column, support.columns[1])).astype(np.int64)
