"""s(x) as the paper has it: every vertex of v(f) is supported."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement_planner_ros.core.body.contact_points import touching_points
from placement_planner_ros.core.body.stable_poses import TIPPING_RISE_M
from placement_planner_ros.core.contacts.coplanarity import coplanar_support
from placement_planner_ros.core.contacts.protrusions import Protrusions
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.types import LEVEL, Array, Index, Mask, Slope


class VertexSupport:
    """Every vertex of v(f) has support, in one plane, and keeps a margin from its end.

    Attributes:
        faces: F.
        regions: R; the reference vertex of each face stands on one of them.
    """

    def __init__(self, problem: Problem, footing: SupportSettings) -> None:
        self.faces = problem.body.faces
        self.regions: tuple[Region, ...] = problem.environment.regions
        self.footing = footing
        self._environment = problem.environment
        self._center = problem.body.center_of_mass
        corners = [face.vertices for face in self.faces]
        self._corners = np.concatenate(corners) if corners else np.empty((0, 3))
        self._first = np.cumsum([0, *map(len, corners)])
        body, faces = problem.body, problem.body.faces
        self._rises = Protrusions(
            problem.environment,
            faces,
            lambda face: touching_points(body, faces[face]),
            footing.contact_tolerance,
        )

    def stable(self, T: Array, faces: Index, slope: Slope) -> Mask:
        """(n,) s(x) of poses (n, 4, 4) on these faces (n,) and one slope."""
        # Every corner of the face needs support, in one plane.
        points, first = _placed_corners(self._corners, self._first, faces, np.ascontiguousarray(T))
        support = self._environment.support_of(slope)
        gaps = support.gaps(points, self.footing.contact_tolerance, self.footing.edge_margin, first)
        widths, above = coplanar_support(points, gaps, first, support.height_noise)
        stable = widths > 0.0
        # Nothing under it lifts the object.
        rows = np.flatnonzero(stable)
        if len(rows):
            planes = np.zeros((len(rows), 3))
            planes[:, 0] = above[rows]
            noise = np.full(len(rows), support.height_noise)
            stable[rows] = ~self._rises.lift(
                T[rows], faces[rows], slope, planes, widths[rows], noise
            )
        # On a slope it must not tip over.
        if slope != LEVEL:
            rows = np.flatnonzero(stable)
            for face in np.unique(faces[rows]):
                on = rows[faces[rows] == face]
                corners = points[first[on, None] + np.arange(first[on[0] + 1] - first[on[0]])]
                centers = T[on, :3, :3] @ self._center + T[on, :3, 3]
                stable[on] = stays_standing(corners - centers[:, None])
        return stable


@njit(cache=True, nogil=True)
def _placed_corners(corners: Array, first: Index, faces: Index, T: Array) -> tuple[Array, Index]:
    """(k, 3) where the corners of each pose's face are, and (n + 1,) which is its first, and k.

    Args:
        corners: (c, 3) of all faces, in the object's frame.
        first: (f + 1,) first corner of each face, and c.
        faces: (n,)
        T: (n, 4, 4) T_world_object.
    """
    # Where the corners of each pose's face begin.
    begins = np.zeros(len(faces) + 1, np.int64)
    for n in range(len(faces)):
        begins[n + 1] = begins[n] + first[faces[n] + 1] - first[faces[n]]
    # Each corner, put into the world.
    points = np.empty((begins[-1], 3))
    for n in range(len(faces)):
        for k in range(begins[n + 1] - begins[n]):
            corner = corners[first[faces[n]] + k]
            for i in range(3):
                points[begins[n] + k, i] = (
                    T[n, i, 0] * corner[0]
                    + T[n, i, 1] * corner[1]
                    + T[n, i, 2] * corner[2]
                    + T[n, i, 3]
                )
    return points, begins


def stays_standing(corners: Array) -> Mask:
    """(n,) whether bodies stay that stand on polygons, as firmly as a rest on level ground does.

    The centre of mass lies inside along gravity, and to tip over any edge it would have to be
    lifted by `TIPPING_RISE_M`: about an edge of direction e, from which it lies at w, it
    goes up to |w| √(1 - e_z²).

    Args:
        corners: (n, k, 3) of each polygon in boundary order, seen from the centre of mass, z up.
    """
    # Sides of the polygon, and whether the centre of mass is over it.
    edges = np.roll(corners, -1, axis=1) - corners
    edges /= np.maximum(np.linalg.norm(edges, axis=2, keepdims=True), 1e-12)
    across = edges[..., 0] * corners[..., 1] - edges[..., 1] * corners[..., 0]
    inside = (across < 0.0).all(axis=1) | (across > 0.0).all(axis=1)
    # How high the centre of mass rises over each side before it falls.
    away = (corners * edges).sum(axis=2, keepdims=True) * edges - corners
    highest = np.linalg.norm(away, axis=2) * np.sqrt(1.0 - edges[..., 2] ** 2)
    lifted = (highest - away[..., 2]).min(axis=1)
    return np.asarray(inside & (lifted >= TIPPING_RISE_M))
