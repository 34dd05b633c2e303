"""The height of a body's centre of mass over the side that is down: what tipping it takes.

Directions that may be down form a sphere. Over it the height is a landscape, and its valleys are
where the body can rest. A facet of the hull that is down is a node of it, turning the body over an
edge to the next facet an arc. Between these the land only rises, so the lowest pass from one facet
to another is found along the arcs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import ConvexHull

from placement_planner_ros.core.body.mesh_components import connected_labels
from placement_planner_ros.core.types import Array, Index, Mask


@dataclass(frozen=True, slots=True, eq=False)
class Tipping:
    """The landscape of one body; heights are metres of its centre of mass.

    Attributes:
        vertices: (n, 3) of the hull, metres.
        facets: (f, 3) rows of vertices, triangles.
        normals: (f, 3) unit, outward: down where the body stands on that facet.
        heights: (f,) above the facet's plane.
        beside: (f, 3) the facets that have an edge in common with each.
        passes: (f, 3) the greatest height on the way there.
    """

    vertices: Array
    facets: Index
    normals: Array
    heights: Array
    beside: Index
    passes: Array

    @classmethod
    def of(cls, points: Array, center: Array) -> Tipping:
        """Of the convex hull of points (n, 3) that has the centre of mass (3,) inside.

        Raises:
            scipy.spatial.QhullError: they have no volume.
        """
        # Facets of the hull, and the height over each.
        hull = ConvexHull(points)
        used, facets = np.unique(hull.simplices, return_inverse=True)
        vertices, facets = points[used], facets.reshape(-1, 3).astype(np.int64)
        normals, beside = hull.equations[:, :3], hull.neighbors.astype(np.int64)
        corners = np.einsum("fik,fk->fi", vertices[facets] - center, normals)
        heights = corners.max(axis=1)
        passes = [_pass_height(normals, heights, other) for other in beside.T]
        return cls(vertices, facets, normals, heights, beside, np.column_stack(passes))

    def valleys(self, depth: float) -> Index:
        """Facets at the bottom of valleys of at least this depth, metres, in the hull's order.

        It is as if water rose from every bottom: where two lakes meet, the shallower one ends, and
        counts if it had become that deep.
        """
        # A tree of the lowest passes, which joins all facets.
        count = len(self.heights)
        one = np.repeat(np.arange(count), 3)
        weights = 1.0 + self.passes.ravel()  # zero is no arc to scipy
        graph = coo_array((weights, (one, self.beside.ravel())), (count, count))
        tree = minimum_spanning_tree(graph).tocoo()
        order = np.argsort(tree.data, kind="stable")
        ends = np.column_stack([tree.row, tree.col])[order].tolist()
        levels = (tree.data[order] - 1.0).tolist()
        heights = self.heights.tolist()
        lower = list(range(count))  # a facet of the same lake, at last that at its bottom

        def bottom(facet: int) -> int:
            while lower[facet] != facet:
                lower[facet] = lower[lower[facet]]
                facet = lower[facet]
            return facet

        found = []
        for (first, second), level in zip(ends, levels, strict=True):
            # Two lakes meet: the shallower one ends.
            low, high = bottom(first), bottom(second)
            if heights[low] > heights[high]:
                low, high = high, low
            if level - heights[high] >= depth:
                found.append(high)
            lower[high] = low
        found.append(bottom(0))
        return np.sort(np.array(found, dtype=np.int64))

    def turned(self, facet: int, others: Index | Mask) -> float:
        """Radians that the body turns by from a facet to the furthest of others."""
        cosine = (self.normals[others] @ self.normals[facet]).min(initial=1.0)
        return float(np.arccos(max(cosine, -1.0)))

    def around(self, facet: int, lowest: float, highest: float) -> Mask:
        """(f,) facets to which the body gets from this one while its height stays between."""
        # Ways between facets that stay within the heights.
        level = (self.heights >= lowest) & (self.heights <= highest)
        open_ = (self.passes <= highest) & level[:, None] & level[self.beside]
        row, side = np.nonzero(open_)
        label = connected_labels(row, self.beside[row, side], len(self.heights))
        return np.asarray(label == label[facet])


def _pass_height(normals: Array, heights: Array, other: Index) -> Array:
    """(f,) the greatest of A cos φ + B sin φ, the height on the way from each facet to another."""
    # The angle between both sides.
    apart = np.linalg.norm(normals - normals[other], axis=1)
    angle = 2.0 * np.arcsin(np.minimum(0.5 * apart, 1.0))
    rise = heights[other] - heights * np.cos(angle)
    # The height has its crest between them, or at one of them.
    top = np.arctan2(rise, heights * np.sin(angle))
    crest = (top > 0.0) & (top < angle)
    return np.where(crest, heights / np.cos(top), np.maximum(heights, heights[other]))
