"""An object that was placed: part of the environment until it is taken away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.self_filter import Outline

SPACING = 0.004
"""Largest distance between neighbouring points on the surface, metres."""
_SLENDER = 4.0
"""Times as long as high is a triangle that a lattice as dense both ways has too many points on."""
_ROWS = 0.7
"""Times `SPACING` from one row of points on such a one to the next."""
_SAME = 1e-5
"""m; objects are at most some metres long, which fits in 21 bits."""


@dataclass(frozen=True, slots=True, eq=False)
class StandingObject:
    """A body where it stands.

    Attributes:
        points: (n, 3) on its surface, at most `SPACING` apart, planning frame.
    """

    body: Body
    T_world_object: pin.SE3
    points: Array

    @classmethod
    def at(cls, body: Body, T_world_object: pin.SE3) -> StandingObject:
        """The body at that pose."""
        T = T_world_object
        points = surface_points(body.vertices[body.triangles])
        return cls(body, pin.SE3(T), np.asarray(points @ T.rotation.T + T.translation))

    def holds(self, points: Array, padding: float) -> npt.NDArray[np.bool_]:
        """Which of (n, 3) points lie in it, or at most `padding` metres from its surface."""
        return ~Outline.of_object(self.body, self.T_world_object, padding).outside(points)


def surface_points(corners: Array) -> Array:
    """(n, 3) points on triangles (t, 3, 3), at most `SPACING` apart.

    Their corners, and a lattice on each that is larger.

    To divide triangles by four until they are small made a box of 2 m 17 s of work and 2.7 GB.
    """
    edges = _edges(corners)
    length, last = edges.max(axis=1), edges.argmax(axis=1)
    sides = corners[:, 1:] - corners[:, :1]
    height = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / np.maximum(length, _SAME)
    parts = np.ceil(length / SPACING).astype(np.int64)
    thin = (parts > 1) & (length > _SLENDER * height)
    found = [corners[parts <= 1].reshape(-1, 3)]
    for n in np.unique(parts[(parts > 1) & ~thin]).tolist():
        i, j = np.nonzero(np.add.outer(np.arange(n + 1), np.arange(n + 1)) <= n)
        shares = np.column_stack([n - i - j, i, j]) / n
        found.append((shares @ corners[(parts == n) & ~thin]).reshape(-1, 3))
    # of a thin one rows along the longest edge, as many points on each
    across = np.ceil(height / (_ROWS * SPACING)).astype(np.int64)
    along = 2 ** np.ceil(np.log2(np.maximum(parts, 1))).astype(np.int64)
    turned = (last[:, None] + (2, 0, 1)) % 3
    for n, m in np.unique(np.column_stack([along, across])[thin], axis=0).tolist():
        rows = np.flatnonzero(thin & (along == n) & (across == m))
        u, v = (x.ravel() for x in np.meshgrid(np.arange(n + 1) / n, np.arange(m + 1) / max(m, 1)))
        shares = np.column_stack([(1.0 - v) * (1.0 - u), (1.0 - v) * u, v])
        found.append((shares @ corners[rows[:, None], turned[rows]]).reshape(-1, 3))
    return _once(np.vstack(found))


def _once(points: Array) -> Array:
    """(k, 3) of points (n, 3), those of one cube of `_SAME` only once."""
    x, y, z = ((points - points.min(axis=0)) / _SAME).astype(np.int64).T
    _, first = np.unique((x << 42) + (y << 21) + z, return_index=True)
    return points[first]


def _edges(corners: Array) -> Array:
    """(t, 3) m, of triangles (t, 3, 3), each from the corner before to the one of its number."""
    return np.asarray(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2))
