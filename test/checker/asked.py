"""What was asked of the placement beside that it is possible, computed from the true solids."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import ConvexHull

from .carried import carried_polygon
from .outlines import distances, ends
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
    "stance": 0.01,
    "toward_front": 1e-6,
}
"""What is forgiven: half a spacing of the cloud at edges."""
_MOST = 0.2
"""m, the greatest distance from an edge that counts."""


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
    if name == "aligned":  # what it is beside known outlines, a test of its own says
        return -0.25 * math.pi, 0.0
    slack = SLACK[name]
    if name == "clearance":
        low, high = clearance(T)
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


def _edge(task: Task, T: Array, tolerances: Tolerances) -> float:
    normal = standing_along(task, T, tolerances)
    feet = feet_of(world_vertices(task, T), normal, tolerances)
    least = _MOST
    for places in ends(task, float(feet[:, 2].mean())):
        if len(places):
            least = min(least, float(distances(places, feet[:, :2]).min()))
    return least


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
