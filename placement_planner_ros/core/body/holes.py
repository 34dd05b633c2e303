"""The holes of a surface that is not quite closed, closed for its centre of mass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from placement_planner_ros.core.body.mesh_components import equal_rows
from placement_planner_ros.core.types import Array


@dataclass(frozen=True, slots=True, eq=False)
class Holes:
    """Holes that share no vertex.

    Attributes:
        middles: (k, 3) metres, of the vertices around each.
        radii: (k,) metres, how far these are from it at most.
        areas: (k,) m² of the patches.
        patches: (t, 3, 3) metres, triangles from the middles to the rims. With them every edge of
            the surface has as many triangles one way as the other.
    """

    middles: Array
    radii: Array
    areas: Array
    patches: Array

    @classmethod
    def of(cls, corners: Array) -> Holes:
        """Of triangles (t, 3, 3), one or more."""
        # Vertices that are equal are one; sides by their ends.
        first, kind = equal_rows(corners.reshape(-1, 3))
        points, sides = corners.reshape(-1, 3)[first], kind.reshape(-1, 3)[:, [0, 1, 1, 2, 2, 0]]
        sides = sides.reshape(-1, 2)
        # Each edge, and how many more triangles run along it one way.
        keys = sides.min(axis=1) * len(points) + sides.max(axis=1)
        _, one, edge = np.unique(keys, return_index=True, return_inverse=True)
        excess = np.bincount(edge.reshape(-1), np.sign(sides[:, 1] - sides[:, 0])).astype(np.int64)
        rows = np.flatnonzero(excess)
        # Each edge as often as a patch needs it, in the direction that the surface lacks.
        low, high = np.sort(sides[one[rows]], axis=1).T
        ends = np.where(excess[rows] > 0, (high, low), (low, high))
        rim, (start, end) = np.unique(
            np.repeat(ends, np.abs(excess[rows]), axis=1), return_inverse=True
        )
        # Rims that are connected are one hole.
        graph = coo_array((np.ones(len(start), np.int8), (start, end)), (len(rim), len(rim)))
        count, label = connected_components(graph, directed=False)
        # Its middle, and a fan of triangles from there to the rim.
        around = np.bincount(label, minlength=count)
        middles = np.stack([np.bincount(label, x, count) / around for x in points[rim].T], axis=1)
        radii = np.zeros(count)
        np.maximum.at(radii, label, np.linalg.norm(points[rim] - middles[label], axis=1))
        patches = np.stack([points[rim[start]], points[rim[end]], middles[label[start]]], axis=1)
        across = np.cross(patches[:, 1] - patches[:, 0], patches[:, 2] - patches[:, 0])
        areas = np.bincount(label[start], 0.5 * np.linalg.norm(across, axis=1), count)
        return cls(middles, radii, areas.astype(np.float64), patches)

    def moves(self, center: Array, volume: float) -> float:
        """Metres that the centre of mass (3,) of the patched solid, of so many m³, may be off.

        Where what is missing bulges out of each hole, or into it, by half as much as that is wide,
        at most: as a hemisphere over a disc, which holds 2/3 of its radius times its area.
        """
        bulges = 2.0 / (3.0 * np.pi) * self.areas**2 / self.radii
        left = volume - float(bulges.sum())
        if not left > 0.0:
            return np.inf
        arms = np.linalg.norm(self.middles - center, axis=1) + self.radii
        return float(bulges @ arms) / left
