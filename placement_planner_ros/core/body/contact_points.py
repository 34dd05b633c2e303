"""Where a body really touches the plane of one of its faces: its feet, a rim, a whole side."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.mesh_cells import surface_points
from placement_planner_ros.core.body.mesh_components import equal_rows
from placement_planner_ros.core.body.placement_face import PlacementFace, outermost_rows
from placement_planner_ros.core.types import SINGLE_ROUNDING, Array, Index

SPACING_M = 0.005
"""m, what touches has a contact point in each square of this side, or of a larger one ..."""
SPREAD_POINTS = 32
"""... so that there are no more squares than the square of this; so many that each have one of the
spread points; and directions in which the outermost contact point is kept."""


class ContactPoints(NamedTuple):
    """Points of the surface that touch a face's plane.

    Attributes:
        points: (k, 2) in the plane, in the frame of the face, in lexicographic order.
        spread: (m,) rows of a few of them that are spread over all.
        room: (k,) m around each that surely touches, too.
    """

    points: Array
    spread: Index
    room: Array


def contact_points(body: Body, face: PlacementFace) -> ContactPoints:
    """Points of the body's surface within its flatness of the plane of a face.

    They lie on the surface itself, so their hull is never larger than that of what touches. The
    outermost are among them.
    """
    points = touching_points(body, face)
    # Triangles that touch with all three corners.
    placed = _placed_vertices(body, face)
    flat = body.triangles[(placed[:, 2] <= body.flatness)[body.triangles].all(axis=1)]
    room = _room_around(points, placed[:, :2], flat)
    return ContactPoints(points, _thinned_rows(points, SPREAD_POINTS), room)


def touching_points(body: Body, face: PlacementFace) -> Array:
    """(k, 2) `ContactPoints.points` alone."""
    # Points of all triangles that come near, then those that do themselves.
    corners = _placed_vertices(body, face)[body.triangles]
    near = corners[corners[:, :, 2].min(axis=1) <= body.flatness]
    found = np.concatenate([np.zeros((0, 3)), *surface_points(near, SPACING_M)])
    points = found[found[:, 2] <= body.flatness, :2]
    # Each once, and no more than are needed.
    points = points[equal_rows(points)[0]]
    return np.asarray(points[_thinned_rows(points, SPREAD_POINTS**2)])


def _placed_vertices(body: Body, face: PlacementFace) -> Array:
    """(n, 3) in the frame of the face, whose plane is at 0."""
    T = face.T_face_object
    return np.asarray(body.vertices @ T.rotation.T + T.translation)


def _room_around(points: Array, corners: Array, triangles: Index) -> Array:
    """(n,) how far points (n, 2) lie inside of what some of the triangles between corners cover.

    That is, from all edges that do not lie between two triangles; 0 outside. Where triangles
    overlap it may be less.
    """
    if len(points) == 0 or len(triangles) == 0:
        return np.zeros(len(points))
    # Edges that only one triangle has are the rim; fronts and backs count once.
    first, same = equal_rows(np.round(corners / SINGLE_ROUNDING))
    distinct = np.unique(np.sort(same[triangles], axis=1), axis=0)
    edges = distinct[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2)
    rows, count = np.unique(edges, axis=0, return_counts=True)
    # The rim as segments.
    begin, end = corners[first[rows[count == 1]]].swapaxes(0, 1)
    along = end - begin
    square = np.maximum((along * along).sum(axis=1), SINGLE_ROUNDING**2)
    a, b, c = corners[triangles].swapaxes(0, 1)
    room = np.zeros(len(points))
    for n, point in enumerate(points):
        # Inside where a triangle has it on the same side of all its edges.
        sides = np.stack([_left_of(a, b, point), _left_of(b, c, point), _left_of(c, a, point)])
        if not ((sides >= 0.0).all(axis=0) | (sides <= 0.0).all(axis=0)).any():
            continue
        # Its distance from the nearest segment.
        share = np.clip(((point - begin) * along).sum(axis=1) / square, 0.0, 1.0)
        room[n] = np.linalg.norm(begin + share[:, None] * along - point, axis=1).min()
    return room


def _left_of(begin: Array, end: Array, point: Array) -> Array:
    """(n,) positive where the point (2,) lies left of the way from begin to end, each (n, 2)."""
    along, away = end - begin, point - begin
    return np.asarray(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0])


def _thinned_rows(points: Array, most: int) -> Index:
    """Rows of points (n, 2): the outermost in each of some directions, and one in each square."""
    if len(points) == 0:
        return np.zeros(0, dtype=np.int64)
    side = SPACING_M
    while True:
        # The first in each square; the squares grow until there are few enough.
        squares = np.floor((points - points.min(axis=0)) / side).astype(np.int64)
        number = squares[:, 0] * (squares[:, 1].max() + 1) + squares[:, 1]
        first = np.unique(number, return_index=True)[1]
        if len(first) <= most:
            return np.unique(np.concatenate([first, outermost_rows(points, SPREAD_POINTS)]))
        side *= max(1.02, np.sqrt(len(first) / most))
