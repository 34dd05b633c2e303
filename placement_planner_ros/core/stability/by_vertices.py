"""s(x) as the paper has it: every vertex of v(f) is supported."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.contact_points import touching
from placement_planner_ros.core.body.rests import GRAVITY, TIPPING_ENERGY
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.stability.footing import Footing
from placement_planner_ros.core.stability.rises import rises
from placement_planner_ros.core.types import LEVEL, Array, Slope

LEANS = 0.025
"""Of the surface under an object against its contact plane, at most; 1.4 degrees."""
_NOISY = 0.4
"""Times the noise of the points that heights at two ends of an object may differ by: surfaces lie
where many points do, so that they are told much better than each of these."""
_ROCKS = 2.0 * math.sqrt(2.0)
"""Times the spread of heights about their plane, over the width, by which an object rocks: of four
corners of a square one that is lower by d leaves d/2 of spread, and is d over the half diagonal."""
_RISES = 1.6
"""Times the noise by which single surfaces under an object may be above the plane under it."""
_LEVEL = 2e-4
"""m by which heights of one level surface may differ."""
_SCATTER = 0.6
"""Times the noise that heights may spread about their plane by."""


class VertexSupport:
    """Every vertex of v(f) has support, in one plane, and keeps a margin from its end.

    Attributes:
        faces: F.
        regions: R; the reference vertex of each face stands on one of them.
    """

    def __init__(self, problem: Problem, footing: Footing) -> None:
        self.faces = problem.body.faces
        self.regions: tuple[Region, ...] = problem.environment.regions
        self.footing = footing
        self._environment = problem.environment
        self._center = problem.body.center_of_mass
        self._contacts = [face.vertices for face in self.faces]
        self._body = problem.body
        self._touching: dict[int, Array] = {}
        self._heights: dict[Slope, Array] = {}

    def stable(self, T: Array, face: int, slope: Slope) -> npt.NDArray[np.bool_]:
        """(n,) s(x) of poses (n, 4, 4) on one face and one slope."""
        points = self._contacts[face] @ T[:, :3, :3].transpose(0, 2, 1)
        points += T[:, None, :3, 3]
        gaps = self._environment.support_of(slope).gaps(
            points.reshape(-1, 3), self.footing.contact_tolerance, self.footing.edge_margin
        )
        gaps = gaps.reshape(len(T), -1)
        stable = np.asarray(np.isfinite(gaps).all(axis=1))
        noise = self._environment.measured.noise
        stable[stable] = in_one_plane(points[stable], gaps[stable], noise)
        stable[stable] = ~self._on_something(points[stable], gaps[stable], T[stable], face, slope)
        if slope != LEVEL:
            centers = T[:, :3, :3] @ self._center + T[:, :3, 3]
            stable &= stays(points - centers[:, None])
        return stable

    def _on_something(
        self, points: Array, gaps: Array, T: Array, face: int, slope: Slope
    ) -> npt.NDArray[np.bool_]:
        """(n,) whether something under the object between its vertices lifts it off them.

        On what is higher in its middle by d an object leans by d over half its width. That may be
        as much as in `in_one_plane`.

        Args:
            points, gaps: (n, k, 3), (n, k) as there.
        """
        support = self._environment.support_of(slope)
        if slope not in self._heights:
            self._heights[slope] = np.sort(support.height)
        xy = points[..., :2] - points[..., :2].mean(axis=1, keepdims=True)
        spread = np.einsum("nki,nkj->nij", xy, xy)
        narrowest = 2.0 * np.sqrt(np.linalg.eigvalsh(spread)[:, 0] / points.shape[1])
        low = gaps.mean(axis=1) + 0.5 * LEANS * narrowest
        low += _RISES * self._environment.measured.noise + _LEVEL
        high = self.footing.contact_tolerance
        z = points[:, 0, 2] - points[:, 0, :2] @ np.array(slope)
        between = [np.searchsorted(self._heights[slope], z + up, "right") for up in (low, high)]
        found = np.asarray(between[1] > between[0])
        if found.any():
            found[found] = rises(
                self._points(face),
                np.ascontiguousarray(T[found]),
                slope,
                low[found],
                high,
                support.origin,
                support.cell_size,
                support.columns,
                support.start,
                support.height,
                support.rectangle,
            )
        return found

    def _points(self, face: int) -> Array:
        """(k, 3) of the object that lie in the plane of that face, made when first asked for."""
        if face not in self._touching:
            inward = self.faces[face].T_face_object.inverse()
            found = touching(self._body, self.faces[face])
            self._touching[face] = found @ inward.rotation[:, :2].T + inward.translation
        return self._touching[face]


def in_one_plane(points: Array, gaps: Array, noise: float) -> npt.NDArray[np.bool_]:
    """(n,) whether what carries objects is a plane, and the one that they are to stand on.

    The plane fitted to the surface under the vertices leans against it by `LEANS` at most, or by
    what noise makes of so short a distance: on steps, and on surfaces that slope differently, the
    object would come to stand otherwise than it was placed. What is left of the heights does not
    let it rock by more than that either: on posts of which one is lower, and on twisted surfaces,
    a fitted plane need not lean.

    Args:
        points: (n, k, 3) vertices.
        gaps: (n, k) m, how far the surface is above each.
        noise: standard deviation of the points, metres.
    """
    xy = points[..., :2] - points[..., :2].mean(axis=1, keepdims=True)
    off = gaps - gaps.mean(axis=1, keepdims=True)
    spread = np.einsum("nki,nkj->nij", xy, xy)
    falls = np.einsum("nki,nk->ni", xy, off)
    slope = np.linalg.solve(spread, falls[..., None])[..., 0]
    narrowest = 2.0 * np.sqrt(np.linalg.eigvalsh(spread)[:, 0] / points.shape[1])
    even = np.linalg.norm(slope, axis=1) <= LEANS + _NOISY * noise / narrowest
    left = np.ptp(off - np.einsum("nki,ni->nk", xy, slope), axis=1)
    return np.asarray(even & (left <= LEANS * narrowest / _ROCKS + _SCATTER * noise))


def stays(corners: Array) -> npt.NDArray[np.bool_]:
    """(n,) whether bodies stay that stand on polygons, as firmly as a rest on level ground does.

    The centre of mass lies inside along gravity, and to tip over any edge it would have to be
    lifted by what `TIPPING_ENERGY` does: about an edge of direction e, from which it lies at w, it
    goes up to |w| √(1 - e_z²).

    Args:
        corners: (n, k, 3) of each polygon in boundary order, seen from the centre of mass, z up.
    """
    edges = np.roll(corners, -1, axis=1) - corners
    edges /= np.maximum(np.linalg.norm(edges, axis=2, keepdims=True), 1e-12)
    across = edges[..., 0] * corners[..., 1] - edges[..., 1] * corners[..., 0]
    inside = (across < 0.0).all(axis=1) | (across > 0.0).all(axis=1)
    away = (corners * edges).sum(axis=2, keepdims=True) * edges - corners
    highest = np.linalg.norm(away, axis=2) * np.sqrt(1.0 - edges[..., 2] ** 2)
    lifted = (highest - away[..., 2]).min(axis=1)
    return np.asarray(inside & (GRAVITY * lifted >= TIPPING_ENERGY))
