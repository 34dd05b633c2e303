"""Where surfaces end, seen from above, and outlines of what stands there."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import ConvexHull

from .task import Array, Task

_SAME = 0.0035
"""m by which surfaces may differ in height that one object stands on."""
_STEP = 0.002
"""m between places that are looked at."""
_BESIDE = 0.015
"""m from a thing that stands on it, the end of a surface does not count."""
_RISE = 0.005
"""m above a surface, what rises higher stands on it ..."""
_BEGIN = 0.02
"""m, ... if it begins no higher above it than that."""


def ends(task: Task, height: float) -> Iterator[Array]:
    """Places (n, 2) at which the surfaces of a height end, side by side."""
    tops = list(_tops(task, height))
    around = things(task, height + _RISE, height + _BEGIN)
    for number, outline in enumerate(tops):
        for places in _sides(outline):
            kept = np.ones(len(places), bool)
            for other, corners in enumerate(tops):
                if other != number:
                    kept &= distances(places, corners) > 1e-3
            for corners in around:
                kept &= distances(places, corners) > _BESIDE
            yield places[kept]


def things(task: Task, low: float, high: float) -> list[Array]:
    """Outlines (k, 2) of the solids that reach above one height and begin below another."""
    found = []
    for solid in task.solids:
        points = np.asarray(solid.vertices)
        if points[:, 2].max() > low and points[:, 2].min() < high:
            found.append(points[ConvexHull(points[:, :2]).vertices, :2])
    return found


def _tops(task: Task, height: float) -> Iterator[Array]:
    """Outlines (k, 2) of the solids whose top is at a height."""
    for solid in task.solids:
        points = np.asarray(solid.vertices)
        top = points[:, 2].max()
        if abs(top - height) < _SAME:
            level = points[points[:, 2] > top - 1e-4][:, :2]
            if len(level) >= 3:
                yield level[ConvexHull(level).vertices]


def _sides(corners: Array) -> Iterator[Array]:
    """Places (n, 2) along each side of an outline (k, 2), the middles of equal pieces of it."""
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        number = max(1, int(np.linalg.norm(b - a) / _STEP))
        yield a + ((np.arange(number) + 0.5) / number)[:, None] * (b - a)


def distances(points: Array, corners: Array) -> Array:
    """(n,) distance of points (n, 2) from a convex outline, 0 inside."""
    hull = ConvexHull(corners)
    inside = (points @ hull.equations[:, :2].T + hull.equations[:, 2]).max(axis=1) <= 0.0
    best = np.full(len(points), np.inf)
    ring = corners[hull.vertices]
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
    return np.where(inside, 0.0, best)
