"""Pieces of meshes: what of a mesh, and of the solid inside it, is on one side of some planes."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from placement_planner_ros.core.body.mesh_components import Components
from placement_planner_ros.core.body.polytope import Polytope, hull_around
from placement_planner_ros.core.types import Array

SLACK = 1e-9
"""Metres that a point on a plane may be beside it by rounding."""

_NORMALS = 64
"""Steps from 0 to 1 of the numbers that a plane's normal is made of."""

_PARALLEL = 1e-8
"""Determinant of three normals that have a line in common: of others it is 1 / _NORMALS³ / 6."""

_NONE = np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class ClippedPiece:
    """What of some components, and of the solids inside them, is within a few planes.

    The solid within the planes is in the hull of the triangles there and of those points inside it
    where three of the planes meet: an extreme point of a solid that planes cut is on its surface or
    is such a point.

    Attributes:
        whole: the components.
        planes: (k, 4) n and d, with n · x + d <= 0 within.
        corners: (t, 3, 3) metres, the triangles, clipped.
        inner: (i, 3) metres, points inside the solid where three of the planes meet.
    """

    whole: Components
    planes: Array
    corners: Array
    inner: Array

    @classmethod
    def of(cls, whole: Components) -> ClippedPiece:
        """All of it."""
        return cls(whole, np.zeros((0, 4)), whole.corners, _NONE)

    @cached_property
    def hull(self) -> Polytope:
        """What holds the piece."""
        return hull_around(np.concatenate([self.corners.reshape(-1, 3), self.inner]))

    def halves(self, plane: Array) -> tuple[ClippedPiece, ClippedPiece] | None:
        """The piece on both sides of a plane (4,); None where there is nothing on one."""
        corners = [clipped(self.corners, side) for side in (plane, -plane)]
        if not all(map(len, corners)):
            return None
        met = [(*pair, plane) for pair in itertools.combinations(self.planes, 2)]
        new = _inside(self.whole, np.array(met), self.planes)
        below, above = (
            ClippedPiece(
                self.whole,
                np.concatenate([self.planes, side[None]]),
                clip,
                np.concatenate([self.inner[self.inner @ side[:3] + side[3] <= SLACK], new]),
            )
            for side, clip in zip((plane, -plane), corners, strict=True)
        )
        return below, above


def inner_points(whole: Components, planes: Array) -> Array:
    """(i, 3) points inside a solid where three of the planes (k, 4) meet, within all of them."""
    threes = [planes[list(rows)] for rows in itertools.combinations(range(len(planes)), 3)]
    return _inside(whole, np.array(threes), planes)


def _inside(whole: Components, threes: Array, planes: Array) -> Array:
    """(i, 3) points inside a solid and within planes (k, 4) where threes of them (n, 3, 4) meet."""
    if not len(threes) or not whole.closed.any():
        return _NONE
    threes = threes[np.abs(np.linalg.det(threes[..., :3])) > _PARALLEL]
    points: Array = np.asarray(
        np.linalg.solve(threes[..., :3], -threes[..., 3:])[..., 0], np.float64
    )
    within = (points @ planes[:, :3].T + planes[:, 3] <= SLACK).all(axis=1)
    points = np.unique(points[within].round(9), axis=0)
    return np.asarray(points[whole.inside(points)])


def plane_through(normal: Array, offset: float) -> Array:
    """(4,) of the plane normal · x = offset, with a normal among few, so that three of such planes
    either meet in a point or are clearly parallel to a line."""
    whole = (normal * (_NORMALS / np.abs(normal).max())).round()
    length = float(np.linalg.norm(whole))
    return np.array([*(whole / length), -offset])


def clipped(corners: Array, plane: Array) -> Array:
    """(k, 3, 3) what of triangles (t, 3, 3) is where n · x + d <= 0."""
    heights = corners @ plane[:3] + plane[3]
    under = heights <= 0.0
    count = under.sum(axis=1)
    made = [corners[count == 3]]
    for wanted in (1, 2):
        chosen = np.flatnonzero(count == wanted)
        # The corner that is alone on its side comes first.
        alone = np.argmax(under[chosen] == (wanted == 1), axis=1)
        order = (alone[:, None] + np.arange(3)) % 3
        c = corners[chosen[:, None], order]
        h = heights[chosen[:, None], order]
        first, second = (
            c[:, 0] + (h[:, 0] / (h[:, 0] - h[:, k]))[:, None] * (c[:, k] - c[:, 0]) for k in (1, 2)
        )
        if wanted == 1:
            made.append(np.stack([c[:, 0], first, second], axis=1))
        else:
            made.append(np.stack([first, c[:, 1], c[:, 2]], axis=1))
            made.append(np.stack([first, c[:, 2], second], axis=1))
    return np.concatenate(made)
