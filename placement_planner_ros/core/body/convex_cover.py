"""A few convex sets that together contain a mesh, and reach little beyond it.

A mesh is halved, and its halves again, until the hull of every piece stays near it; pieces whose
common hull does so too are joined again. All triangles, and all of a solid, are in a part by
construction: a part is the hull of what is in its box. How far parts reach beyond the mesh is
bounded by cells: no part meets one that holds a point further away than `Cover.excess`.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.body.convex_part import (
    MAX_PARTS,
    ConvexPart,
    grown_hull,
    hull_around,
    simpler_hull,
)
from placement_planner_ros.core.body.mesh import MAX_PIECES
from placement_planner_ros.core.body.mesh_cells import FarCells, MeshCells
from placement_planner_ros.core.body.mesh_components import Components, Triangles
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import SINGLE_ROUNDING, Array

COVER_TOLERANCE_M = 0.010
"""m by which a mesh's cover may reach beyond it; half of that where it is small."""

SMALL_MESH_M = 0.25
"""m, the diagonal of the box around a small mesh, as of a hand or an object."""


@dataclass(frozen=True, slots=True, eq=False)
class Cover:
    """Convex sets that together contain a mesh and the solid inside its closed components.

    Attributes:
        parts: in the mesh's own frame and scale.
        excess: metres. Every point of a part is this near to the mesh, or is enclosed by it:
            within a closed component, or in a hollow with no opening twice as wide.
        closed: whether all components are closed; open ones are sheets without an inside.
    """

    parts: tuple[ConvexPart, ...]
    excess: float
    closed: bool


def cover_tolerance(vertices: Array) -> float:
    """Metres that the cover of a mesh of vertices (n, 3) may reach beyond it."""
    small = float(np.linalg.norm(np.ptp(vertices, axis=0))) < SMALL_MESH_M
    return 0.5 * COVER_TOLERANCE_M if small else COVER_TOLERANCE_M


def convex_cover(vertices: Array, triangles: Triangles) -> Cover:
    """Cover a mesh by at most `MAX_PARTS` convex parts, which reach beyond it by `cover_tolerance`,
    or further where it needs too many; `stoppable`.

    Args:
        vertices: (n, 3) metres.
        triangles: (t, 3) rows of vertices.
    """
    components = Components.of(vertices, triangles)
    # Cut until every piece is near the mesh.
    cells = MeshCells(components.corners, cover_tolerance(vertices))
    hulls, far = _cut_hulls(components.corners, cells)
    # Join what stays near it; where too many are left, let them reach further.
    hulls = _joined_pairs(hulls, far)
    while len(hulls) > MAX_PARTS:
        far = far.further_away()
        hulls = _joined_pairs(hulls, far)
    # Simpler hulls are larger: what is far is judged by what came out.
    made = [simpler_hull(hull, 0.5 * cells.cell) for hull in hulls]
    held = zip(hulls, made, strict=True)
    hulls = [simpler_hull(hull, 0.0) if far.is_met_by(one) else one for hull, one in held]
    while any(map(far.is_met_by, hulls)):
        far = far.further_away()
    parts = tuple(map(grown_hull, hulls))
    return Cover(parts, far.reach, bool(components.closed.all()))


def hull_cover(vertices: Array, triangles: Triangles) -> Cover:
    """The cover that is there at once: the hull; arguments as of `convex_cover`."""
    components = Components.of(vertices, triangles)
    hull = hull_around(components.corners.reshape(-1, 3))
    part = grown_hull(simpler_hull(hull, 0.0))
    # No point of a hull is further from its vertices than half the diagonal of their box.
    excess = 0.5 * float(np.linalg.norm(np.ptp(part.vertices, axis=0)))
    return Cover((part,), excess, bool(components.closed.all()))


@dataclass(frozen=True, slots=True, eq=False)
class CutPiece:
    """What of a mesh, and of the solid inside it, is within a box.

    An extreme point of that is on the mesh, or is a corner of the box inside the solid.

    Attributes:
        box: (2, 3) metres, its lower and its upper ends.
        corners: (t, 3, 3) metres, the triangles, clipped.
        hull: what holds the piece.
    """

    box: Array
    corners: Array
    hull: ConvexPart

    def halves(self, cells: MeshCells) -> tuple[CutPiece, ...]:
        """The piece on both sides of its longest side's middle; nothing where all is on one."""
        # The triangles on both sides of where the longest side of the hull has its middle.
        low, high = _box_around(self.hull)
        axis = int(np.argmax(high - low))
        middle = 0.5 * (low[axis] + high[axis])
        halves = []
        for end, corners in zip((1, 0), cut_triangles(self.corners, axis, middle), strict=True):
            # With the corners of its box inside the solid.
            box = self.box.copy()
            box[end, axis] = middle
            points = np.concatenate([corners.reshape(-1, 3), self._solid_corners(box, cells)])
            if not len(points):
                return ()
            halves.append(CutPiece(box, corners, hull_around(points)))
        return tuple(halves)

    def _solid_corners(self, box: Array, cells: MeshCells) -> Array:
        """(k, 3) corners of a box within its own that are inside the solid."""
        corners = np.array(list(itertools.product(*box.T)))
        # Cells are taken to be inside where the surface passes them: what the hull lacks is not.
        beyond = corners @ self.hull.normals.T - self.hull.offsets
        corners = corners[(beyond <= SINGLE_ROUNDING).all(axis=1)]
        return np.asarray(corners[cells.inside(corners)])


def cut_triangles(corners: Array, axis: int, at: float) -> tuple[Array, Array]:
    """(k, 3, 3) what of triangles (t, 3, 3) is below a plane across an axis, and what is above.

    trimesh slices as well, but extrapolates sides that lie almost in the plane.
    """
    heights = corners[:, :, axis] - at
    under = heights <= 0.0
    count = under.sum(axis=1)
    cut = np.flatnonzero((count == 1) | (count == 2))
    # Of what crosses the plane the corner that is alone on its side comes first.
    single = count[cut] == 1
    order = (np.argmax(under[cut] == single[:, None], axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = corners[cut[:, None], order].swapaxes(0, 1)
    h, hb, hc = heights[cut[:, None], order].T[..., None]
    # Its tip, and two triangles of the rest.
    p, q = a + h / (h - hb) * (b - a), a + h / (h - hc) * (c - a)
    tip = np.stack([a, p, q], axis=1)
    rest = np.concatenate([np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1)])
    tips_below, rest_below = single, np.tile(~single, 2)
    below = np.concatenate([corners[count == 3], tip[tips_below], rest[rest_below]])
    return below, np.concatenate([corners[count == 0], tip[~tips_below], rest[~rest_below]])


def _cut_hulls(corners: Array, cells: MeshCells) -> tuple[list[ConvexPart], FarCells]:
    """Halve a mesh of triangles (t, 3, 3), larger pieces first, until no hull meets a far cell, and
    what is far: more than the tolerance where it would be too many pieces."""
    far = cells.far(cells.tolerance)
    around = np.stack([cells.low, cells.high])
    open_ = deque([CutPiece(around, corners, hull_around(corners.reshape(-1, 3)))])
    done: list[ConvexPart] = []
    while open_:
        step("covering a mesh with convex parts")
        piece = open_.popleft()
        if not far.is_met_by(piece.hull):
            done.append(piece.hull)
            continue
        # Cut it, as long as there may be more pieces; else all that is left is judged anew.
        few = len(done) + len(open_) + 1 < MAX_PIECES
        halves = piece.halves(cells) if few else ()
        if not halves:
            far = far.further_away()
        open_.extend(halves or [piece])
    return done, far


def _joined_pairs(hulls: Sequence[ConvexPart], far: FarCells) -> list[ConvexPart]:
    """Those left of some hulls when no common hull of two is free of far points."""
    # Sizes of the boxes around pairs, each once; infinite where they are apart, or did not join.
    joined, left = list(hulls), np.ones(len(hulls), np.bool_)
    boxes = np.stack([_box_around(hull) for hull in hulls])
    sizes = np.stack([_common_sizes(box, boxes, far.reach) for box in boxes])
    sizes[np.tril_indices(len(hulls))] = np.inf
    while np.isfinite(sizes).any():
        step("covering a mesh with convex parts")
        # The pair with the smallest box.
        i, j = divmod(int(sizes.argmin()), len(hulls))
        both = _common_hull(joined[i], joined[j], far)
        if both is None:
            sizes[i, j] = np.inf
            continue
        # One of the two is now both, the other is gone.
        joined[i], boxes[i], left[j] = both, _box_around(both), False
        sizes[[i, j]] = sizes[:, [i, j]] = np.inf
        sizes[i] = np.where(left, _common_sizes(boxes[i], boxes, far.reach), np.inf)
        sizes[i, i] = np.inf
    return [hull for hull, one in zip(joined, left, strict=True) if one]


def _common_sizes(box: Array, others: Array, reach: float) -> Array:
    """(n,) m³ of the boxes around one (2, 3) and each of others (n, 2, 3); infinite where they are
    further apart."""
    lows, highs = others[:, 0], others[:, 1]
    apart = (np.maximum(lows, box[0]) - np.minimum(highs, box[1])).max(axis=1) > reach
    sizes = (np.maximum(highs, box[1]) - np.minimum(lows, box[0])).prod(axis=1)
    return np.where(apart, np.inf, sizes)


def _box_around(hull: ConvexPart) -> Array:
    """(2, 3) metres, its lower and its upper ends."""
    return np.stack([hull.vertices.min(axis=0), hull.vertices.max(axis=0)])


def _common_hull(a: ConvexPart, b: ConvexPart, far: FarCells) -> ConvexPart | None:
    """The hull of both; None where it holds far points."""
    some, others = (hull.vertices[:: 1 + len(hull.vertices) // 32] for hull in (a, b))
    middles = 0.5 * (some[:, None] + others).reshape(-1, 3)
    if far.cells[far.grid.cells_of(middles)].any():  # which is found sooner
        return None
    made = hull_around(np.concatenate([a.vertices, b.vertices]))
    return None if far.is_met_by(made) else made
