"""Arrays of `~/markers`."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from visualization_msgs.msg import Marker, MarkerArray

from placement_planner_ros.core.types import Array


@dataclass(frozen=True, slots=True, eq=False)
class DrawnMarkers:
    """The parts of a marker array that the page draws.

    Attributes:
        volume: (k, 2, 3) corners of V's boxes, metres.
        regions: (3 t, 3) corners of the regions' triangles, metres.
        object: (n, 3) corners of the object's triangles in its own frame; of no rows where no
            placement is drawn.
        standing: (k, 3) points on what earlier runs have placed.
        contacts: (m, 2, 3) from where it leans towards what holds it there, with the friction cones
            that count; none where it stands.
        wall: (3 w, 3) corners of the triangles of what it leans on.
    """

    volume: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    regions: Array = field(default_factory=lambda: np.zeros((0, 3)))
    object: Array = field(default_factory=lambda: np.zeros((0, 3)))
    standing: Array = field(default_factory=lambda: np.zeros((0, 3)))
    contacts: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    wall: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @classmethod
    def of(cls, message: MarkerArray) -> DrawnMarkers:
        """Of a message; markers that are none of the node's are left out."""
        boxes, regions, corners = [], np.zeros((0, 3)), np.zeros((0, 3))
        standing, contacts = [np.zeros((0, 3))], np.zeros((0, 2, 3))
        wall = np.zeros((0, 3))
        for marker in message.markers:
            # what is deleted is not drawn
            if marker.action != Marker.ADD:
                continue
            if marker.ns == "target_volume":
                p, s = marker.pose.position, marker.scale
                middle, half = np.array([p.x, p.y, p.z]), np.array([s.x, s.y, s.z]) / 2
                boxes.append((middle - half, middle + half))
            elif marker.ns == "regions":
                regions = _marker_points(marker)
            elif marker.ns == "object":
                corners = _marker_points(marker)
            elif marker.ns == "contacts":
                lines = _marker_points(marker)
                contacts = lines[: len(lines) // 2 * 2].reshape(-1, 2, 3)
            elif marker.ns == "wall":
                wall = _marker_points(marker)
            elif marker.ns == "standing":
                standing.append(_marker_points(marker))
        volume = np.array(boxes).reshape(-1, 2, 3)
        points = np.vstack(standing)
        # browsers draw nothing at all where one number is none
        drawn = (volume, regions, corners, points, contacts, wall)
        if not all(np.isfinite(each).all() for each in drawn):
            raise ValueError("it holds numbers that are not finite")
        return cls(
            volume,
            regions[: len(regions) // 3 * 3],
            corners[: len(corners) // 3 * 3],
            points,
            contacts,
            wall[: len(wall) // 3 * 3],
        )


def _marker_points(marker: Marker) -> Array:
    return np.array([(p.x, p.y, p.z) for p in marker.points], dtype=np.float64).reshape(-1, 3)
