"""Arrays of `~/markers`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from visualization_msgs.msg import Marker, MarkerArray

from placement_planner_ros.core.types import Array

_CORNERS = {"regions": 3, "object": 3, "contacts": 2, "wall": 3, "standing": 1}
"""By namespace, of how many points one thing is: a triangle, a line or a point."""


def drawn_points(message: MarkerArray | None) -> Mapping[str, Array]:
    """By namespace (n, 3) points of what the page draws, metres, as many as whole things have; and
    `target_volume`, the corners (k, 2, 3) of V's boxes. None stands for nothing.

    Raises:
        ValueError: a number is not finite: browsers would draw nothing at all.
    """
    found: dict[str, list[Array]] = {name: [np.zeros((0, 3))] for name in _CORNERS}
    boxes: list[Array] = []
    for marker in () if message is None else message.markers:
        # what is deleted is not drawn
        if marker.action != Marker.ADD:
            continue
        if marker.ns == "target_volume":
            p, s = marker.pose.position, marker.scale
            middle, half = np.array([p.x, p.y, p.z]), np.array([s.x, s.y, s.z]) / 2
            boxes.append(np.stack([middle - half, middle + half]))
        elif marker.ns in found:
            whole = len(marker.points) // _CORNERS[marker.ns] * _CORNERS[marker.ns]
            points = [(p.x, p.y, p.z) for p in marker.points[:whole]]
            found[marker.ns].append(np.array(points).reshape(-1, 3))
    drawn = {name: np.vstack(points) for name, points in found.items()}
    drawn["target_volume"] = np.array(boxes).reshape(-1, 2, 3)
    if not all(np.isfinite(each).all() for each in drawn.values()):
        raise ValueError("it holds numbers that are not finite")
    return drawn
