"""A few convex sets that together contain a mesh, and reach little beyond it.

A mesh is cut by planes until the hull of every piece stays near it, and pieces whose common hull
does so too are joined again. All triangles, and all of a solid, are in a part by construction: a
part is the hull of what is on its side of the planes. How far parts reach beyond the mesh is
bounded by cells: no part meets one that holds a point further away than `Cover.excess`.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from scipy.spatial import QhullError

from placement_planner_ros.core.body.mesh_cells import FarCells, Mask, MeshCells, surface_points
from placement_planner_ros.core.body.mesh_components import Components, Triangles
from placement_planner_ros.core.body.polytope import (
    Polytope,
    even_directions,
    grown_hull,
    hull_around,
    simpler_hull,
)
from placement_planner_ros.core.types import Array, frozen_array

MAX_PARTS = 32
"""Parts that a cover may have."""

MAX_PIECES = 256
"""Pieces that a mesh is cut into before some are joined again."""

MAX_VERTICES = 128
"""Vertices that a part may have."""

PLAIN_VERTICES = 24
"""Vertices of a part that are not worth having fewer of."""

COVER_TOLERANCE_M = 0.010
"""m by which a mesh's cover may reach beyond it; half of that where it is small."""

SMALL_MESH_M = 0.25
"""m, the diagonal of the box around a small mesh, as of a hand or an object."""

REACH_GROWTH = 1.2
"""Factor on the reach of parts where there are too many."""

SAMPLE_POINTS = 1500
"""Points of a piece by which cuts are compared; of far cells in its hull a third of that."""

CUTS_ALONG_AXIS = 9
"""Places along each axis at which a cut is tried."""


_DIRECTIONS = even_directions(48)


@dataclass(frozen=True, slots=True, eq=False)
class Cover:
    """Convex sets that together contain a mesh and the solid inside its closed components.

    Attributes:
        parts: (m, 3) metres each, in the mesh's own frame and scale. A part is the hull of its
            vertices, of which it has 4 to `MAX_VERTICES`.
        excess: metres. Every point of a part is this near to the mesh, or is enclosed by it:
            within a closed component, or in a hollow with no opening twice as wide.
        closed: whether all components are closed; open ones are sheets without an inside.
    """

    parts: tuple[Array, ...]
    excess: float
    closed: bool

    def __post_init__(self) -> None:
        parts = tuple(frozen_array(part, (-1, 3)) for part in self.parts)
        object.__setattr__(self, "parts", parts)


def cover_tolerance(vertices: Array) -> float:
    """Metres that the cover of a mesh of vertices (n, 3) may reach beyond it."""
    small = float(np.linalg.norm(np.ptp(vertices, axis=0))) < SMALL_MESH_M
    return 0.5 * COVER_TOLERANCE_M if small else COVER_TOLERANCE_M


def coarse_cover_in_words(cover: Cover, tolerance: float) -> str:
    """That a cover reaches further than twice its tolerance, metres; '' where it does not."""
    if cover.excess <= 2.0 * tolerance:
        return ""
    return (
        f"its convex cover reaches {cover.excess:.3f} m beyond its mesh instead of {tolerance:g}, "
        "which slows down checks beside it; a simpler mesh has a closer one"
    )


def convex_cover(
    vertices: Array,
    triangles: Triangles,
    tolerance: float,
    step: Callable[[], None] = lambda: None,
) -> Cover:
    """Cover a mesh by at most `MAX_PARTS` convex parts.

    Args:
        vertices: (n, 3) metres.
        triangles: (t, 3) rows of vertices.
        tolerance: metres that parts may reach beyond the mesh; more where it needs too many parts.
        step: called before each stage of the work, a second at the most; what it raises ends it.
    """
    components = Components.of(vertices, triangles)
    step()
    # Cut until every piece is near the mesh, then join what stays near it.
    cells = MeshCells(components.corners, tolerance)
    try:
        pieces, far = _cut_pieces(CutPiece.of(components.corners), cells, step)
        hulls, far = _joined_hulls([piece.hull for piece in pieces], cells, far, step)
    except QhullError:
        return hull_cover(vertices, triangles)
    # Simpler hulls are larger: what is far is judged by what came out.
    while any(map(far.is_met_by, hulls)):
        far = cells.far(REACH_GROWTH * far.reach)
    parts = tuple(map(grown_hull, hulls))
    return Cover(parts, far.reach, bool(components.closed.all()))


def hull_cover(vertices: Array, triangles: Triangles) -> Cover:
    """The cover that is there at once: the hull, or the box where that has too many vertices;
    arguments as of `convex_cover`."""
    components = Components.of(vertices, triangles)
    points = components.corners.reshape(-1, 3)
    try:
        # The hull with fewer vertices.
        hull = hull_around(points)
        part = grown_hull(simpler_hull(hull, 0.0, MAX_VERTICES))
    except QhullError:
        part = np.zeros((0, 3))
    if not 4 <= len(part) <= MAX_VERTICES:
        # The box, a little larger.
        low, high = points.min(axis=0) - 1e-5, points.max(axis=0) + 1e-5
        part = np.array(list(itertools.product(*np.stack([low, high], axis=1))))
    # No point of a hull is further from its vertices than half the diagonal of their box.
    excess = 0.5 * float(np.linalg.norm(np.ptp(part, axis=0)))
    return Cover((part,), excess, bool(components.closed.all()))


@dataclass(frozen=True, eq=False)
class CutPiece:
    """What of a mesh, and of the solid inside it, is within a few planes.

    An extreme point of a solid that planes cut is on its surface, or is one inside it where three
    of the planes meet: their hull holds the piece.

    Attributes:
        planes: (k, 4) n and d, with n · x + d <= 0 within.
        corners: (t, 3, 3) metres, the triangles, clipped.
        inner: (i, 3) metres, points inside the solid where three of the planes meet.
    """

    planes: Array
    corners: Array
    inner: Array

    @classmethod
    def of(cls, corners: Array) -> CutPiece:
        """All of it."""
        return cls(np.zeros((0, 4)), corners, np.zeros((0, 3)))

    @cached_property
    def hull(self) -> Polytope:
        """What holds the piece."""
        return hull_around(np.concatenate([self.corners.reshape(-1, 3), self.inner]))

    def halves(self, plane: Array, cells: MeshCells) -> tuple[CutPiece, ...]:
        """The piece on both sides of a plane (4,); nothing where all is on one."""
        # Points of the solid where the new plane meets two others.
        new = _inner_points(self.planes, plane, cells)
        hull = self.hull.planes  # cells are taken to be inside where the surface passes them
        new = new[(new @ hull[:, :3].T + hull[:, 3] <= 1e-9).all(axis=1)]
        halves = []
        for side in (plane, -plane):
            # What is on this side of the plane, and nothing where that is all.
            corners = clipped_triangles(self.corners, side)
            inner = self.inner[self.inner @ side[:3] + side[3] <= 0.0]
            if not len(corners) and not len(inner):
                return ()
            planes = np.concatenate([self.planes, side[None]])
            halves.append(CutPiece(planes, corners, np.concatenate([inner, new])))
        return tuple(halves)


def _inner_points(planes: Array, plane: Array, cells: MeshCells) -> Array:
    """(i, 3) points inside the solid, within planes (k, 4), where two of these meet another."""
    # Every two of the planes, with the new one.
    pairs = np.array(list(itertools.combinations(planes, 2))).reshape(-1, 2, 4)
    threes = np.concatenate([pairs, np.broadcast_to(plane, (len(pairs), 1, 4))], axis=1)
    # Of parallel planes, and of three along a line, a point would be far away.
    threes = threes[np.abs(np.linalg.det(threes[..., :3])) > 1e-6]
    # Where the three meet, within all other planes and the solid.
    points = np.linalg.solve(threes[..., :3], -threes[..., 3:])[..., 0]
    points = points[(points @ planes[:, :3].T + planes[:, 3] <= 1e-9).all(axis=1)]
    points = points[((points > cells.low) & (points < cells.high)).all(axis=1)]
    return np.asarray(points[cells.inside(points)])


def clipped_triangles(corners: Array, plane: Array) -> Array:
    """(k, 3, 3) what of triangles (t, 3, 3) is where n · x + d <= 0."""
    # Triangles that are under the plane with all corners stay whole.
    heights = corners @ plane[:3] + plane[3]
    under = heights <= 0.0
    count = under.sum(axis=1)
    made = [corners[count == 3]]
    # Of the others a triangle is left, or two.
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


def _cut_pieces(
    whole: CutPiece, cells: MeshCells, step: Callable[[], None]
) -> tuple[list[CutPiece], FarCells]:
    """Cut a mesh, the piece that meets most far cells first, until none meets one, and what is far:
    more than the tolerance where it would be too many pieces."""
    far = cells.far(0.92 * cells.tolerance)  # the rest is for simpler hulls
    number = itertools.count()
    open_ = [(0, next(number), whole, far.met_by(whole.hull))]
    done: list[CutPiece] = []
    while open_:
        step()
        # The piece that meets most far cells.
        _, _, piece, met = heapq.heappop(open_)
        if not len(met):
            done.append(piece)
            continue
        # Cut it, as long as there may be more pieces.
        halves: tuple[CutPiece, ...] = ()
        if len(done) + len(open_) + 1 < MAX_PIECES:
            plane = _best_plane(piece, met, far.half)
            halves = () if plane is None else piece.halves(plane, cells)
        if not halves:  # all that is left is judged anew
            far = cells.far(REACH_GROWTH * far.reach)
            left = [piece, *(each for _, _, each, _ in open_)]
            open_ = [(-1, next(number), each, far.met_by(each.hull)) for each in left]
            continue
        for half in halves:  # its hull is within that of the whole
            meets = far.met_by(half.hull, met)
            heapq.heappush(open_, (-len(meets), next(number), half, meets))
    return done, far


def _best_plane(piece: CutPiece, met: Array, half: float) -> Array | None:
    """The plane (4,) on whose sides the hulls hold the fewest far cells, about.

    Slabs in many directions stand for hulls. Of planes that leave as many one is better that is
    nearer to the middle and across a longer side: it takes several cuts before the pieces of a ring
    leave its hole free.
    """
    points, cells = _sample_points(piece), met[:: 1 + 3 * len(met) // SAMPLE_POINTS]
    along, cells_along = points @ _DIRECTIONS.T, cells @ _DIRECTIONS.T

    # Normals along the axes and the principal axes.
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    normals = np.concatenate([np.eye(3), axes])
    longest = float(np.ptp(points @ normals.T, axis=0).max())
    best, found = np.inf, None
    for normal in normals:
        # Planes across each of them.
        at = points @ normal
        width = float(np.ptp(at))
        for share in np.linspace(0.0, 1.0, CUTS_ALONG_AXIS + 2)[1:-1]:
            offset = float(at.min()) + share * width
            below = at <= offset
            if width < 2.0 * half or below.all():
                continue
            # Far cells that both sides would hold, about.
            cost = _held_share(along, cells_along, below) + _held_share(along, cells_along, ~below)
            cost += 0.2 * abs(share - 0.5) + 0.1 * (1.0 - width / longest)
            if cost < best:
                best, found = cost, np.array([*normal, -offset])
    return found


@njit(cache=True, nogil=True)
def _held_share(along: Array, cells_along: Array, chosen: Mask) -> float:
    """Share of cells that are between the ends of the chosen points in every direction.

    Args:
        along, cells_along: (n, d), (m, d) places of points and of cells in d directions.
        chosen: (n,).
    """
    directions = along.shape[1]
    low, high = np.full(directions, np.inf), np.full(directions, -np.inf)
    # The ends of the slab in each direction.
    for i in range(len(along)):
        if chosen[i]:
            for d in range(directions):
                low[d], high[d] = min(low[d], along[i, d]), max(high[d], along[i, d])
    # The cells that are in all slabs.
    held = 0
    for i in range(len(cells_along)):
        inside = True
        for d in range(directions):
            if not low[d] <= cells_along[i, d] <= high[d]:
                inside = False
                break
        held += inside
    return held / len(cells_along)


def _sample_points(piece: CutPiece) -> Array:
    """(n, 3) of its hull's vertices and of its triangles, evenly."""
    rng = np.random.default_rng(0)
    # No more triangles, points and vertices than are compared.
    corners, vertices = piece.corners, piece.hull.vertices
    if len(corners) > SAMPLE_POINTS:
        corners = corners[rng.choice(len(corners), SAMPLE_POINTS, replace=False)]
    spacing = float(np.linalg.norm(np.ptp(vertices, axis=0))) / 40.0
    points = np.concatenate([piece.inner, *surface_points(corners, spacing)])
    if len(points) > SAMPLE_POINTS:
        points = points[rng.choice(len(points), SAMPLE_POINTS, replace=False)]
    if len(vertices) > SAMPLE_POINTS:
        vertices = vertices[rng.choice(len(vertices), SAMPLE_POINTS, replace=False)]
    return np.concatenate([points, vertices])


def _joined_hulls(
    hulls: Sequence[Polytope], cells: MeshCells, far: FarCells, step: Callable[[], None]
) -> tuple[list[Polytope], FarCells]:
    """As few hulls as joining one pair after the other leaves, the pair with the smallest box
    around it first, and what is far."""
    parts = dict(enumerate(hulls))
    while True:
        # Join; where too many are left, let them reach further.
        _join_pairs(parts, far, step)
        if len(parts) <= MAX_PARTS:
            return [_simpler_part(part, far) for part in parts.values()], far
        far = cells.far(REACH_GROWTH * far.reach)


def _simpler_part(hull: Polytope, far: FarCells) -> Polytope:
    """One around it with fewer vertices, that holds no far points either, where there is."""
    if len(hull.vertices) <= PLAIN_VERTICES:
        return hull
    for share in (0.1, 0.03, 0.01):
        made = simpler_hull(hull, share * far.reach, MAX_VERTICES)
        if not far.is_met_by(made):
            return made
    return hull if len(hull.vertices) <= MAX_VERTICES else made


def _join_pairs(parts: dict[int, Polytope], far: FarCells, step: Callable[[], None]) -> None:
    """Join parts as long as no hull of two holds far points."""
    pairs: list[tuple[float, int, int]] = []

    def consider(one: int, others: Sequence[int]) -> None:
        low, high = parts[one].vertices.min(axis=0), parts[one].vertices.max(axis=0)
        for other in others:
            vertices = parts[other].vertices
            lows, highs = vertices.min(axis=0), vertices.max(axis=0)
            if (np.maximum(lows, low) - np.minimum(highs, high)).max() <= far.reach:
                around = (np.maximum(highs, high) - np.minimum(lows, low)).prod()
                heapq.heappush(pairs, (float(around), one, other))

    for one in parts:
        # All pairs, then those with each new part.
        consider(one, [other for other in parts if other > one])
    while pairs:
        _, i, j = heapq.heappop(pairs)
        if i not in parts or j not in parts:
            continue
        step()
        # Join the two with the smallest box unless that holds far points.
        both = _common_hull(parts[i], parts[j], far)
        if both is not None:
            new = max(parts) + 1
            del parts[i], parts[j]
            parts[new] = both
            consider(new, [other for other in parts if other != new])


def _common_hull(a: Polytope, b: Polytope, far: FarCells) -> Polytope | None:
    """The hull of both; None where it holds far points."""
    some, others = (hull.vertices[:: 1 + len(hull.vertices) // 32] for hull in (a, b))
    if far.hold_one_of(0.5 * (some[:, None] + others).reshape(-1, 3)):  # which is found sooner
        return None
    made = hull_around(np.concatenate([a.vertices, b.vertices]))
    return None if far.is_met_by(made) else made
