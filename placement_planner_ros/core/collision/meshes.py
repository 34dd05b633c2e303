"""Meshes as they are: trees of boxes over the original triangles, and which of them are closed.

Covers of convex parts say what is free; what they leave open is decided here (`against_mesh`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from placement_planner_ros.core.body.mesh_components import Components
from placement_planner_ros.core.types import Array, Index, Mask, frozen_array
from placement_planner_ros.core.weak_cache import weak_lru_cache

_LEAF_TRIANGLES = 4
"""Triangles in a leaf, at most."""


class MeshArrays(NamedTuple):
    """m meshes for the kernels, each in its own frame.

    The tree of a mesh is complete: below its node i, counted from the root, are 2i + 1 and 2i + 2.
    Rows that belong to mesh i run from its entry in a `first` array to that of mesh i + 1.
    """

    first_node: Index
    """(m + 1,)."""
    first_leaf: Index
    """(m + 1,) in `leaves`."""
    first_component: Index
    """(m + 1,)."""
    boxes: Array
    """(k, 6) box around what is below each node, lower then upper corner."""
    leaves: Index
    """(l + 1,) first triangle of each leaf."""
    corners: Array
    """(3 t, 3) corners of the triangles, one after the other; closed components face outward."""
    closed: Mask
    """(t,) whether a triangle bounds a solid; else it is part of a sheet."""
    components: Array
    """(c, 3) a point of each component."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class MeshTree:
    """One mesh for `MeshArrays`: the same arrays, but `leaves` from 0 on.

    Attributes:
        boxes: (k, 6).
        leaves: (l + 1,).
        corners: (3 t, 3).
        closed: (t,).
        components: (c, 3).
        digest: of the triangles, and which bound a solid; computed unless given.
    """

    boxes: Array
    leaves: Index
    corners: Array
    closed: Mask
    components: Array
    digest: bytes = b""

    def __post_init__(self) -> None:
        arrays = self.boxes, self.leaves, self.corners, self.closed, self.components
        for array in arrays:
            array.setflags(write=False)
        if not self.digest:
            content = hashlib.sha256(self.corners.tobytes() + self.closed.tobytes())
            object.__setattr__(self, "digest", content.digest())

    @classmethod
    def of(cls, vertices: Array, triangles: Index) -> MeshTree:
        """Of a mesh: vertices (n, 3) metres, triangles (t, 3)."""
        # Components; the solid is where a closed one, which faces outward, winds about a point.
        made = Components.of(np.asarray(vertices, dtype=np.float64), triangles)
        # Leaves of a few triangles near each other.
        order, leaves = tree_order(made.corners.mean(axis=1), _LEAF_TRIANGLES)
        corners, label = made.corners[order], made.label[order]
        _, one = np.unique(label, return_index=True)
        # What has two corners at one place bounds nothing; its neighbours meet there.
        point = (corners == np.roll(corners, 1, axis=1)).all(axis=2).any(axis=1)
        return cls(
            boxes=frozen_array(_tree_boxes(corners, leaves), (-1, 6)),
            leaves=leaves,
            corners=frozen_array(corners.reshape(-1, 3)),
            closed=made.closed[label] & ~point,
            components=frozen_array(corners[one, 0], (-1, 3)),
        )


def tree_order(centers: Array, most: int) -> tuple[Index, Index]:
    """Triangles in the order of a complete tree's leaves, and the first of each leaf and their
    number.

    Each node is cut in two halves of as many triangles across the longest side of the box around
    their centres (t, 3), all nodes of a level at once.

    Args:
        most: triangles in a leaf.
    """
    # As many levels as leaves of that size need.
    count = len(centers)
    depth = max(0, int(np.ceil(np.log2(count / most))))
    # Places along each axis, equal ones alike: whole numbers are sorted in a third of the time.
    ranks = np.stack([np.unique(x, return_inverse=True)[1].reshape(-1) for x in centers.T], axis=1)
    order = np.arange(count)
    first = np.array([0, count])
    for _ in range(depth):
        # Each node is halved along its longest extent, by the triangles' middles.
        placed = centers[order]
        spans = np.maximum.reduceat(placed, first[:-1]) - np.minimum.reduceat(placed, first[:-1])
        sizes = np.diff(first)
        node = np.repeat(np.arange(len(sizes)), sizes)
        along = ranks[order, spans.argmax(axis=1)[node]]
        order = order[np.argsort(node * count + along, kind="stable")]
        first = np.sort(np.concatenate([first, first[:-1] + sizes // 2]))
    return order, first


def _tree_boxes(corners: Array, leaves: Index) -> Array:
    """(k, 6) boxes of the complete tree over leaves (l + 1,) of triangles (t, 3, 3)."""
    # Boxes of the leaves, then of two nodes each, up to the root.
    level = np.hstack(
        [
            np.minimum.reduceat(corners.min(axis=1), leaves[:-1]),
            np.maximum.reduceat(corners.max(axis=1), leaves[:-1]),
        ]
    )
    levels = [level]
    while len(level) > 1:
        lower = np.minimum(level[::2, :3], level[1::2, :3])
        level = np.hstack([lower, np.maximum(level[::2, 3:], level[1::2, 3:])])
        levels.append(level)
    return np.vstack(levels[::-1])


def shared_arrays(trees: tuple[MeshTree, ...]) -> MeshArrays:
    """`mesh_arrays`, remembered, since they are the largest part of a robot, as long as the last
    tree is there, which is the object's where there is one."""
    return _remembered_arrays(trees[-1], trees[:-1]) if trees else mesh_arrays(trees)


@weak_lru_cache("last", maxsize=2)
def _remembered_arrays(last: MeshTree, others: tuple[MeshTree, ...]) -> MeshArrays:
    return mesh_arrays([*others, last])


def mesh_arrays(trees: Sequence[MeshTree]) -> MeshArrays:
    """Meshes one after the other."""
    triangles = _first_rows([len(tree.closed) for tree in trees])
    leaves = [tree.leaves[:-1] + first for tree, first in zip(trees, triangles, strict=False)]
    closed = np.zeros(0, dtype=np.bool_), *(tree.closed for tree in trees)
    return MeshArrays(
        first_node=_first_rows([len(tree.boxes) for tree in trees]),
        first_leaf=_first_rows([len(tree.leaves) - 1 for tree in trees]),
        first_component=_first_rows([len(tree.components) for tree in trees]),
        boxes=np.vstack([np.zeros((0, 6)), *(tree.boxes for tree in trees)]),
        leaves=np.concatenate([*leaves, triangles[-1:]]),
        corners=np.vstack([np.zeros((0, 3)), *(tree.corners for tree in trees)]),
        closed=np.concatenate(closed),
        components=np.vstack([np.zeros((0, 3)), *(tree.components for tree in trees)]),
    )


def _first_rows(sizes: Sequence[int]) -> Index:
    return np.cumsum([0, *sizes], dtype=np.int64)
