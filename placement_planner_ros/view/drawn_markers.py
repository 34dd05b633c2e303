"""Arrays of `~/markers`, and the surface of the regions in small pieces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from visualization_msgs.msg import Marker, MarkerArray

from placement_planner_ros.core.types import Array

PIECE = 0.02
"""m, the longest side of a piece."""
MOST_PIECES = 6_000
"""More than these, and pieces are made larger."""


@dataclass(frozen=True, slots=True, eq=False)
class DrawnMarkers:
    """The parts of a marker array that the page draws.

    Attributes:
        volume: (k, 2, 3) corners of V's boxes, metres.
        regions: (m, 4, 3) corners of the regions' rectangles, metres.
        object: (n, 3) corners of the object's triangles in its own frame; of no rows where no
            placement is drawn.
        standing: (k, 3) points on what earlier runs have placed.
    """

    volume: Array
    regions: Array
    object: Array
    standing: Array

    @classmethod
    def of(cls, message: MarkerArray) -> DrawnMarkers:
        """Of a message; markers that are none of the node's are left out."""
        boxes, regions, corners = [], np.zeros((0, 4, 3)), np.zeros((0, 3))
        standing = [np.zeros((0, 3))]
        for marker in message.markers:
            if marker.action != Marker.ADD:
                continue
            if marker.ns == "target_volume":
                p, s = marker.pose.position, marker.scale
                middle, half = np.array([p.x, p.y, p.z]), np.array([s.x, s.y, s.z]) / 2
                boxes.append((middle - half, middle + half))
            elif marker.ns == "regions":
                regions = region_rectangles(_marker_points(marker))
            elif marker.ns == "object":
                corners = _marker_points(marker)
            elif marker.ns == "standing":
                standing.append(_marker_points(marker))
        volume = np.array(boxes).reshape(-1, 2, 3)
        points = np.vstack(standing)
        finite = (np.isfinite(each).all() for each in (volume, regions, corners, points))
        if not all(finite):
            raise ValueError("it holds numbers that are not finite")
        return cls(volume, regions, corners[: len(corners) // 3 * 3], points)


def _marker_points(marker: Marker) -> Array:
    return np.array([(p.x, p.y, p.z) for p in marker.points], dtype=np.float64).reshape(-1, 3)


def region_rectangles(corners: Array) -> Array:
    """(k, 4, 3) corners in order of the rectangles that (6 k, 3) triangle corners make up.

    What is left over at the end is left out.
    """
    whole = corners[: len(corners) // 6 * 6].reshape(-1, 6, 3)
    return np.asarray(whole[:, [0, 1, 2, 5]])


def cut_rectangles(of: Array) -> Array:
    """(n, 4, 3): rectangles (k, 4, 3), each cut evenly into pieces of at most `PIECE`."""
    if len(of) == 0:
        return np.zeros((0, 4, 3))
    sides = np.stack(
        [np.linalg.norm(of[:, 1] - of[:, 0], axis=1), np.linalg.norm(of[:, 3] - of[:, 0], axis=1)],
        axis=1,
    )
    longest = PIECE
    while np.maximum(1, np.ceil(sides / longest)).prod(axis=1).sum() > MOST_PIECES:
        longest *= 1.5
        if longest > 10.0:
            break
    counts = np.maximum(1, np.ceil(sides / longest)).astype(int)
    each = counts.prod(axis=1)
    which = np.repeat(np.arange(len(of)), each)
    number = np.arange(len(which)) - np.repeat(np.cumsum(each) - each, each)
    place = np.column_stack(np.divmod(number, counts[which, 1]))
    a, b, d = of[which, 0], of[which, 1] - of[which, 0], of[which, 3] - of[which, 0]
    corners = []
    for step in ((0, 0), (1, 0), (1, 1), (0, 1)):
        u, v = ((place + step) / counts[which]).T
        corners.append(a + u[:, None] * b + v[:, None] * d)
    return np.stack(corners, axis=1)
