"""Which points are inside of closed triangles, and the voxels of an object."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import coal
import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, cKDTree

from .pieces import Piece
from .task import Array

DEEP = 1.0
"""m, the depth of what lies wholly inside of a mesh."""


def in_bounds(shape: coal.CollisionGeometry, point: Array) -> bool:
    """Whether a point (3,) is within the box around a shape, whose box is computed."""
    box = shape.aabb_local
    return bool((point >= box.min_).all() and (point <= box.max_).all())


def inside(corners: Array, point: Array) -> bool:
    """Whether closed triangles (t, 3, 3) wind around a point (3,)."""
    if not ((point > corners.min(axis=(0, 1))) & (point < corners.max(axis=(0, 1)))).all():
        return False
    return bool(wound(corners, point[None])[0])


def wound(corners: Array, points: Array) -> npt.NDArray[np.bool_]:
    """Which points (n, 3) closed triangles (t, 3, 3) wind around."""
    found = np.zeros(len(points), dtype=bool)
    chunk = max(1, 1_000_000 // len(corners))
    for row in range(0, len(points), chunk):
        away = corners[None] - points[row : row + chunk, None, None]
        a, b, c = (away[:, :, k] for k in range(3))
        na, nb, nc = (np.linalg.norm(each, axis=2) for each in (a, b, c))
        volume = (a * np.cross(b, c)).sum(axis=2)
        whole = na * nb * nc + (a * b).sum(axis=2) * nc + (b * c).sum(axis=2) * na
        turned = np.arctan2(volume, whole + (c * a).sum(axis=2) * nb).sum(axis=1)
        found[row : row + chunk] = np.abs(turned) > np.pi
    return found


@functools.lru_cache(maxsize=16)
def _wound(corners: bytes, points: bytes) -> npt.NDArray[np.bool_]:
    """`wound`, remembered: one object is checked in many cases, and it takes seconds."""
    return wound(np.frombuffer(corners).reshape(-1, 3, 3), np.frombuffer(points).reshape(-1, 3))


def piece_voxels(pieces: Sequence[Piece], size: float = 0.005) -> Array:
    """(n, 3) centres inside of solids, and of voxels that sheets pass through, of the voxels of a
    lattice centred on the bounding box."""
    everything = np.vstack([piece.corners.reshape(-1, 3) for piece in pieces])
    low, high = everything.min(axis=0), everything.max(axis=0)
    counts = np.ceil((high - low) / size - 1e-9)
    ticks = [
        (low[i] + high[i]) / 2 + (np.arange(counts[i]) - (counts[i] - 1) / 2) * size
        for i in range(3)
    ]
    lattice = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.zeros(len(lattice), dtype=bool)
    for piece in pieces:
        if piece.solid:
            hull = ConvexHull(piece.corners.reshape(-1, 3))
            inside |= (lattice @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1) < 1e-9
        elif piece.closed:
            inside |= _wound(piece.corners.tobytes(), lattice.tobytes())
        else:
            tree = cKDTree(lattice)
            for a, b, c in piece.corners:
                longest = max(np.linalg.norm(b - a), np.linalg.norm(c - a), np.linalg.norm(c - b))
                ticks_ = np.linspace(0, 1, int(np.ceil(2 * longest / size)) + 2)
                u, v = (each.ravel() for each in np.meshgrid(ticks_, ticks_))
                kept = u + v <= 1 + 1e-9
                on = a + u[kept, None] * (b - a) + v[kept, None] * (c - a)
                inside[tree.query(on, p=np.inf)[1]] = True
    return np.asarray(lattice[inside])
