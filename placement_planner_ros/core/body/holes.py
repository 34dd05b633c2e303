"""The holes of a surface that is not quite closed, closed for its centre of mass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from placement_planner_ros.core.body.mesh import Triangles, volumes
from placement_planner_ros.core.types import Array

_BULGE = 2.0 / (3.0 * np.pi)
"""m³ over a hole, of its area² / radius: a hemisphere's over a disc; half a cylinder's over a slit
is less, 0.196."""


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
    def of(cls, vertices: Array, triangles: Triangles) -> Holes:
        """Of vertices (n, 3), metres, equal ones merged, and triangles (t, 3)."""
        sides = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        keys = sides.min(axis=1) * len(vertices) + sides.max(axis=1)
        _, first, edge = np.unique(keys, return_index=True, return_inverse=True)
        excess = np.bincount(edge.reshape(-1), np.sign(sides[:, 1] - sides[:, 0])).astype(np.int64)
        rows = np.flatnonzero(excess)
        # Each edge as often as a patch needs it, in the direction that the surface lacks.
        low, high = np.sort(sides[first[rows]], axis=1).T
        starts, ends = np.where(excess[rows] > 0, (high, low), (low, high))
        starts, ends = (np.repeat(each, np.abs(excess[rows])) for each in (starts, ends))
        rim, index = np.unique(np.concatenate([starts, ends]), return_inverse=True)
        start, end = index.reshape(2, -1)
        graph = coo_array((np.ones(len(start), np.int8), (start, end)), (len(rim), len(rim)))
        count, label = connected_components(graph, directed=False)
        around = np.bincount(label, minlength=count)
        middles = np.zeros((count, 3))
        np.add.at(middles, label, vertices[rim])
        middles /= around[:, None]
        radii = np.zeros(count)
        np.maximum.at(radii, label, np.linalg.norm(vertices[rim] - middles[label], axis=1))
        patches = np.stack([vertices[starts], vertices[ends], middles[label[start]]], axis=1)
        across = np.cross(patches[:, 1] - patches[:, 0], patches[:, 2] - patches[:, 0])
        areas = np.bincount(label[start], 0.5 * np.linalg.norm(across, axis=1), count)
        return cls(middles, radii, areas.astype(np.float64), patches)

    def moves(self, center: Array, volume: float) -> float:
        """Metres that the centre of mass (3,) of the patched solid, of so many m³, may be off.

        Where what is missing bulges out of each hole, or into it, by half as much as that is wide,
        at most.
        """
        bulges = _BULGE * self.areas**2 / self.radii
        left = volume - float(bulges.sum())
        if not left > 0.0:
            return np.inf
        arms = np.linalg.norm(self.middles - center, axis=1) + self.radii
        return float(bulges @ arms) / left


NO_HOLES = Holes(np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros((0, 3, 3)))
"""Of a surface that is closed."""


def together(each: Sequence[Holes]) -> Holes:
    """Of several surfaces."""
    return Holes(
        np.concatenate([holes.middles for holes in each]),
        np.concatenate([holes.radii for holes in each]),
        np.concatenate([holes.areas for holes in each]),
        np.concatenate([holes.patches for holes in each]),
    )


def volume_of(corners: Array) -> float:
    """m³ that triangles (t, 3, 3) enclose."""
    return float(volumes(corners - corners.mean(axis=(0, 1))).sum()) if len(corners) else 0.0
