"""Connected components of meshes, solids and sheets."""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from .shapes import convex
from .task import Array, Triangles


def mesh_components(vertices: Array, triangles: Triangles) -> list[tuple[Array, bool]]:
    """Connected components of any mesh: corners (t, 3, 3), and whether every edge is of two."""
    places, same = np.unique(vertices, axis=0, return_inverse=True)
    triangles = same.reshape(-1)[triangles]
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    ends = edges.reshape(-1, 2).T
    graph = coo_matrix((np.ones(len(ends[0])), (ends[0], ends[1])), (len(places),) * 2)
    count, label = connected_components(graph, directed=False)
    found = []
    for rows in (label[triangles[:, 0]] == k for k in range(count)):
        if rows.any():
            uses = np.unique(edges[rows].reshape(-1, 2), axis=0, return_counts=True)[1]
            found.append((places[triangles[rows]], bool((uses == 2).all())))
    return found


@dataclass(frozen=True)
class Piece:
    """A connected component of the object.

    Attributes:
        corners: (t, 3, 3) of its triangles.
        closed: whether they close a solid; else they are a sheet.
        solid: whether that is convex, so that `shape` is all of it; else `shape` is the surface.
    """

    corners: Array
    closed: bool
    solid: bool
    shape: coal.CollisionGeometry


def object_pieces(vertices: Array, triangles: Triangles) -> list[Piece]:
    """Each connected component of any mesh; by its indices, unless it is open like that."""
    vertices, triangles = np.asarray(vertices), np.asarray(triangles)
    ends = triangles[:, [0, 0]].ravel(), triangles[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(ends[0])), ends), (len(vertices),) * 2)
    label = connected_components(graph, directed=False)[1][triangles[:, 0]]
    found: list[Piece] = []
    left = []
    for k in np.unique(label):
        rows = triangles[label == k]
        edges = np.sort(rows[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        if (np.unique(edges, axis=0, return_counts=True)[1] == 2).all():
            found.append(_piece(vertices[rows], True))
        else:
            left.append(rows)
    if left:
        found += [_piece(*each) for each in mesh_components(vertices, np.vstack(left))]
    return found


def _piece(corners: Array, closed: bool) -> Piece:
    points = corners.reshape(-1, 3)
    surface = coal.BVHModelOBBRSS()
    surface.beginModel(len(corners), len(points))
    for triangle in corners:
        surface.addTriangle(*triangle)
    surface.endModel()
    surface.computeLocalAABB()
    if closed and np.linalg.matrix_rank(points - points[0], tol=1e-9) == 3:
        planes = ConvexHull(points).equations
        looked_at = np.concatenate([points, corners.mean(axis=1)])
        chunk = max(1, 2_000_000 // len(planes))
        chunks = (looked_at[row : row + chunk] for row in range(0, len(looked_at), chunk))
        if all((at @ planes[:, :3].T + planes[:, 3]).max(axis=1).min() > -1e-6 for at in chunks):
            return Piece(corners, True, True, convex(np.unique(points, axis=0)))
    return Piece(corners, closed, False, surface)
