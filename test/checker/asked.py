"""What was asked of the placement beside that it is possible, computed from the true solids."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial import ConvexHull

from .carried import carried_polygon
from .stance import standing_along
from .surface import feet_of
from .task import Array, Task, Tolerances, world_vertices

SCALES = {
    "clearance": 0.1,
    "near": 0.1,
    "turn": 0.5,
    "high": 0.1,
    "edge": 0.05,
    "aligned": 0.2,
    "stance": 0.2,
    "toward_front": 1.0,
}
"""The difference in each term's unit that counts as 1."""
SLACK = {
    "clearance": 0.012,
    "near": 1e-5,
    "turn": 1e-4,
    "high": 1e-3,
    "edge": 0.01,
    "aligned": 0.12,
    "stance": 0.01,
    "toward_front": 1e-6,
}
"""What is forgiven: half a spacing of the cloud at edges, and what it turns short sides by."""
_SAME = 0.0035
"""m by which surfaces may differ in height that one object stands on."""
_MOST = 0.2
"""m, the greatest distance from an edge that counts."""
_STEP = 0.002
"""m between places that are looked at along the edges of surfaces."""
_BESIDE = 0.015
"""m from a thing that stands on it, the end of a surface does not count."""
_TIED = 0.02
"""m by which things may be farther and still be taken for the nearest."""


def check_asked(task: Task, T: Array, objective: float, clearance, tolerances) -> list[str]:
    """Rules that a pose (4, 4) breaks, and a weighted objective that is another.

    Args:
        clearance: least and greatest C of a pose.
    """
    asked, found = task.asked, []
    if asked.up is not None:
        up = T[:3, :3] @ np.asarray(asked.up, dtype=float)
        lean = math.acos(np.clip(up[2] / np.linalg.norm(up), -1.0, 1.0))
        if lean > asked.up_tolerance + 1e-4:
            found.append(f"object.up: leans by {lean:.4f} rad")
    if asked.front is not None:
        front = T[:3, :3] @ np.asarray(asked.front, dtype=float)
        azimuth = math.atan2(front[1], front[0]) - asked.front_direction
        off = abs(math.remainder(azimuth, 2.0 * math.pi))
        if off > asked.front_tolerance + 1e-4:
            found.append(f"object.front: faces {off:.4f} rad away")
    for name, least in asked.at_least.items():
        _, high = bounds(task, name, T, clearance, tolerances)
        if high < least:
            found.append(f"require_terms: {name} is at most {high:.4f}, not {least}")
    if asked.weights:
        ends = np.array([0.0, 0.0])
        for name, weight in asked.weights.items():
            low_high = np.array(bounds(task, name, T, clearance, tolerances))
            ends += np.sort(weight * low_high / SCALES[name])
        if not ends[0] - 1e-6 <= objective <= ends[1] + 1e-6:
            found.append(f"objective: {objective:.4f}, is {ends[0]:.4f} to {ends[1]:.4f}")
    return found


def bounds(task: Task, name: str, T: Array, clearance, tolerances) -> tuple[float, float]:
    """Least and greatest value of a term at a pose (4, 4)."""
    slack = SLACK[name]
    if name == "clearance":
        low, high = clearance(T)
    elif name == "aligned":
        values = list(_aligned(task, T, tolerances))
        low, high = (min(values), max(values)) if values else (0.0, 0.0)
    else:
        low = high = _VALUES[name](task, T, tolerances)
    return low - slack, high + slack


def _near(task: Task, T: Array, tolerances: Tolerances) -> float:
    return -float(np.linalg.norm(T[:3, 3] - np.asarray(task.asked.near_pose)[:3]))


def _turn(task: Task, T: Array, tolerances: Tolerances) -> float:
    x, y, z, w = np.asarray(task.asked.near_pose)[3:]
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    cosine = 0.5 * (np.trace(R.T @ T[:3, :3]) - 1.0)
    return -math.acos(np.clip(cosine, -1.0, 1.0))


def _high(task: Task, T: Array, tolerances: Tolerances) -> float:
    normal = standing_along(task, T, tolerances)
    return float(feet_of(world_vertices(task, T), normal, tolerances)[:, 2].mean())


def _stance(task: Task, T: Array, tolerances: Tolerances) -> float:
    """Over each edge of what carries it, the angle between gravity and the plane through the edge
    and the centre of mass."""
    normal = standing_along(task, T, tolerances)
    feet = feet_of(world_vertices(task, T), normal, tolerances)
    com = T[:3, :3] @ task.center_of_mass + T[:3, 3]
    corners = feet[ConvexHull(feet[:, :2]).vertices]
    if task.support == "polygon":
        carried = carried_polygon(task, T, normal, tolerances)
        corners = np.column_stack([carried, np.full(len(carried), feet[:, 2].mean())])
    least = math.pi
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (b - a) / np.linalg.norm(b - a)
        inward = com - a - (com - a) @ along * along
        outward = np.cross(along, [0.0, 0.0, 1.0])
        least = min(least, math.atan2(-(inward @ outward), inward[2]))
    return least


def _tops(task: Task, height: float) -> Iterator[tuple[str, Array]]:
    """Outlines (k, 2) of the solids whose top is at a height."""
    for solid in task.solids:
        points = np.asarray(solid.vertices)
        top = points[:, 2].max()
        if abs(top - height) < _SAME:
            level = points[points[:, 2] > top - 1e-4][:, :2]
            if len(level) >= 3:
                yield solid.name, level[ConvexHull(level).vertices]


def _things(task: Task, height: float, above: float) -> Iterator[Array]:
    """Outlines (k, 2) of the solids that reach from a surface upwards."""
    for solid in task.solids:
        points = np.asarray(solid.vertices)
        low, high = points[:, 2].min(), points[:, 2].max()
        if high > height + 0.005 and low < height + above:
            yield points[ConvexHull(points[:, :2]).vertices, :2]


def _ends(task: Task, height: float) -> Iterator[tuple[Array, float]]:
    """Places (n, 2) at which the surfaces of a height end, side by side with their direction."""
    tops = list(_tops(task, height))
    things = list(_things(task, height, 0.02))
    for name, outline in tops:
        for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            length = float(np.linalg.norm(b - a))
            places = a + np.linspace(0.0, 1.0, max(2, int(length / _STEP)))[:, None] * (b - a)
            kept = np.ones(len(places), bool)
            for other, corners in tops:
                if other != name:
                    kept &= _from(places, corners) > 1e-3
            for corners in things:
                kept &= _from(places, corners) > _BESIDE
            yield places[kept], math.atan2(*(b - a)[::-1])


def _from(points: Array, corners: Array) -> Array:
    """(n,) distance of points (n, 2) from a convex outline, 0 inside."""
    hull = ConvexHull(corners)
    inside = (points @ hull.equations[:, :2].T + hull.equations[:, 2]).max(axis=1) <= 0.0
    best = np.full(len(points), np.inf)
    ring = corners[hull.vertices]
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
    return np.where(inside, 0.0, best)


def _edge(task: Task, T: Array, tolerances: Tolerances) -> float:
    normal = standing_along(task, T, tolerances)
    feet = feet_of(world_vertices(task, T), normal, tolerances)
    least = _MOST
    for places, _ in _ends(task, float(feet[:, 2].mean())):
        if len(places):
            least = min(least, float(_from(places, feet[:, :2]).min()))
    return least


def _aligned(task: Task, T: Array, tolerances: Tolerances) -> Iterator[float]:
    """The angle of each side that is about the longest from each thing or end that is about the
    nearest."""
    vertices = world_vertices(task, T)
    normal = standing_along(task, T, tolerances)
    feet = feet_of(vertices, normal, tolerances)[:, :2]
    ring = feet[ConvexHull(feet).vertices]
    middle = ring.mean(axis=0)[None]
    sides = np.roll(ring, -1, axis=0) - ring
    lengths = np.linalg.norm(sides, axis=1)
    longest = [math.atan2(y, x) for x, y in sides[lengths > 0.99 * lengths.max()]]
    height = float(vertices[:, 2].min())
    found = [
        (float(np.linalg.norm(places - middle, axis=1).min()), angle)
        for places, angle in _ends(task, height)
        if len(places)
    ]
    for corners in _things(task, height, float(np.ptp(vertices, axis=0).max())):
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            share = np.clip((middle[0] - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            away = float(np.linalg.norm(middle[0] - a - share * (b - a)))
            found.append((away, math.atan2(*(b - a)[::-1])))
    nearest = min((distance for distance, _ in found), default=0.0)
    for distance, angle in found:
        if distance <= nearest + _TIED:
            for along in longest:
                yield -abs(math.remainder(along - angle, 0.5 * math.pi))


def _toward_front(task: Task, T: Array, tolerances: Tolerances) -> float:
    """The bundled example of an entry point: minus how far the centre of mass is behind V's side
    of least x."""
    center = T[:3, :3] @ task.center_of_mass + T[:3, 3]
    return float(task.volume[:, 0, 0].min() - center[0])


_VALUES = {
    "near": _near,
    "turn": _turn,
    "high": _high,
    "stance": _stance,
    "edge": _edge,
    "toward_front": _toward_front,
}
