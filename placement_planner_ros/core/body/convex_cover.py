"""A few convex sets that together contain a mesh, and reach little beyond it.

A mesh is cut by planes until the hull of every piece stays near it, and pieces whose common hull
does so too are joined again. That every triangle and every point of a solid is in a part is proven
afterwards, whatever the cuts were. How far parts reach beyond the mesh is bounded by cells: no part
meets one that holds a point further away than `Cover.excess`.
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import QhullError

from placement_planner_ros.core.body.mesh_components import Components, Labels, Mask, Triangles
from placement_planner_ros.core.body.mesh_pieces import (
    ClippedPiece,
    clipped,
    inner_points,
    plane_through,
)
from placement_planner_ros.core.body.mesh_surroundings import Far, MeshSurroundings, surface_points
from placement_planner_ros.core.body.polytope import (
    ROUNDING,
    Polytope,
    grown,
    holds,
    hull_around,
    simpler,
)
from placement_planner_ros.core.types import Array, frozen_array

Floats = npt.NDArray[np.float32]

MOST_PARTS = 32
"""Parts that a cover may have."""

MOST_VERTICES = 128
"""Vertices that a part may have."""

TOLERANCE, SMALL_TOLERANCE = 0.010, 0.005
"""m by which a mesh's cover may reach beyond it, and that of a small one: of a hand, an object."""

_SMALL = 0.25
"""m; the box around a small mesh has a shorter diagonal than this."""

_APART = 16
"""Components that are cut each for itself, the largest; the others are cut together."""

_LARGE = 0.1
"""Share of a mesh's size from which on a component is large."""

_PIECES = 128
"""Pieces that a mesh is cut into at most before some are joined again."""

_MANY, _ROUGH = 20_000, 1.0
"""Triangles of a mesh from which on cuts are looked for in a rougher one, of cubes that large a
share of the tolerance."""

_GROWTH = 1.2
"""Factor on the reach of parts where there are too many."""

_SPARE = 0.92
"""Share of the tolerance that cuts aim at: the rest is for rounding and simpler hulls."""

_SIMPLER = (0.1, 0.03, 0.01)
"""Shares of the reach that a simpler hull may reach beyond the one it stands for: as much as keeps
clear of far cells."""

_CUTS, _PROMISING, _NEAR = 9, 3, 2
"""Places along each axis at which a cut is tried, on how many axes the best of them is looked at
closely, and how many beside the best of all."""

_ALIKE = 1e-3
"""Of two normals whose cosine is nearer to 1, one is enough."""

_POINTS = 1500
"""Points of a piece by which cuts are compared, about."""

_CORNERS = 300
"""Vertices of its hull besides, and the outermost."""

_ALONG = 40.0
"""Points along the whole of a piece, at the most."""

_CELLS = 500
"""Cells by which they are."""

_OFF_MIDDLE, _NARROW, _DEEP = 0.2, 0.1, 0.2
"""What counts besides the shares of far cells that hulls hold: twice how far from the middle a cut
is, how much shorter the side is than the longest, how deep the cells are in the hulls."""

_FROM = 32
"""Vertices of a part from which points between two parts are taken, at most."""

_HALVINGS = 2
"""Times that the bound on the excess is narrowed."""


def _directions() -> Array:
    """(d, 3) of the boxes by which cuts are compared."""
    steps = [d for d in itertools.product((-1, 0, 1), repeat=3) if d > (0, 0, 0)]
    finer = [d for d in itertools.product((-2, -1, 1, 2), repeat=3) if d > (0, 0, 0)]
    made = np.array(steps + [d for d in finer if sorted(map(abs, d)) in ([1, 1, 2], [1, 2, 2])])
    return np.asarray(made / np.linalg.norm(made, axis=1)[:, None])


_DIRECTIONS = _directions()

_OUTWARD = 64
"""Directions, and the opposite ones, along which the outermost points of a side are taken."""


def _evenly() -> Array:
    """(`_OUTWARD`, 3) unit, evenly over half a sphere."""
    z = (np.arange(_OUTWARD) + 0.5) / _OUTWARD
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_OUTWARD)
    flat = np.sqrt(1.0 - z**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


_EVENLY = _evenly()


@dataclass(frozen=True, slots=True, eq=False)
class Cover:
    """Convex sets that together contain a mesh and the solid inside its closed components.

    Attributes:
        parts: (m, 3) metres each, in the mesh's own frame and scale. A part is the hull of its
            vertices, of which it has 4 to `MOST_VERTICES`.
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
    small = float(np.linalg.norm(np.ptp(vertices, axis=0))) < _SMALL
    return SMALL_TOLERANCE if small else TOLERANCE


def convex_cover(
    vertices: Array,
    triangles: Triangles,
    tolerance: float,
    step: Callable[[], None] = lambda: None,
) -> Cover:
    """Cover a mesh by at most `MOST_PARTS` convex parts.

    Args:
        vertices: (n, 3) metres.
        triangles: (t, 3) rows of vertices.
        tolerance: metres that parts may reach beyond the mesh; more where it needs too many parts.
        step: called before each stage of the work, a second at the most; what it raises ends it.
    """
    components = Components.of(vertices, triangles)
    step()
    around = MeshSurroundings(components.corners, tolerance)
    closed = bool(components.closed.all())
    try:
        made = _cut_and_proven(components, around, step)
    except QhullError:
        made = None
    if made is None:
        return hull_cover(vertices, triangles)
    parts, reach = made
    return Cover(tuple(parts), _excess(parts, around, reach, step), closed)


def hull_cover(vertices: Array, triangles: Triangles) -> Cover:
    """The cover that is there at once: the hull; arguments as of `convex_cover`."""
    components = Components.of(vertices, triangles)
    part = _hull_or_box(components.corners.reshape(-1, 3))
    # No point of a hull is further from its vertices than half the diagonal of their box.
    excess = 0.5 * float(np.linalg.norm(np.ptp(part, axis=0)))
    return Cover((part,), excess, bool(components.closed.all()))


def _cut_and_proven(
    components: Components, around: MeshSurroundings, step: Callable[[], None]
) -> tuple[list[Array], float] | None:
    """Vertices (m, 3) of each part, and metres that they reach beyond the mesh, about; None where
    they are not proven to hold it."""
    groups = _groups(components)
    roots = [CoverRegion(ClippedPiece.of(group)) for group in groups]
    reach = _SPARE * around.tolerance
    if len(components.corners) > _MANY:
        rough = [
            CoverRegion(ClippedPiece.of(group.coarser(_ROUGH * around.tolerance)))
            for group in groups
        ]
        reach = _cut(rough, around, reach, step)
        for root, like in zip(roots, rough, strict=True):
            root.cut_like(like, step)
    reach = _cut(roots, around, reach, step)
    leaves = [leaf for root in roots for leaf in root.leaves()]
    parts, reach = _joined(leaves, around, reach, step)
    for number, part in enumerate(parts):
        for leaf in part.leaves:
            leaf.part = number
    made = [grown(part.hull) for part in parts]
    return (made, reach) if all(proven(root, made, step) for root in roots) else None


class CoverRegion:
    """A piece, or the two that a plane makes of it: a tree, with the number of a part each leaf."""

    def __init__(self, piece: ClippedPiece) -> None:
        self.whole = piece.whole
        self.piece: ClippedPiece | None = piece
        self.plane = np.zeros(4)
        self.halves: tuple[CoverRegion, ...] = ()
        self.part = 0

    def cut(self, plane: Array) -> bool:
        """Make it two; False where all is on one side."""
        assert self.piece is not None
        halves = self.piece.halves(plane)
        if halves is None:
            return False
        self.piece, self.plane = None, plane
        self.halves = tuple(CoverRegion(half) for half in halves)
        return True

    def cut_like(self, other: CoverRegion, step: Callable[[], None]) -> None:
        """Cut by the same planes as another, as far as there is something on both sides."""
        step()
        if other.halves and self.cut(other.plane):
            for half, like in zip(self.halves, other.halves, strict=True):
                half.cut_like(like, step)

    def leaves(self) -> Iterator[CoverRegion]:
        """All that were not cut."""
        if not self.halves:
            yield self
        for half in self.halves:
            yield from half.leaves()


def proven(root: CoverRegion, parts: Sequence[Array], step: Callable[[], None]) -> bool:
    """Whether each triangle, clipped at the planes of the regions, and each point of a solid within
    them is in the part of its region, with spare."""
    open_ = [(root, root.whole.corners, np.zeros((0, 4)))]
    while open_:
        region, corners, planes = open_.pop()
        if not region.halves:
            step()
            points = np.concatenate([corners.reshape(-1, 3), inner_points(root.whole, planes)])
            if not holds(parts[region.part], points):
                return False
        for half, plane in zip(region.halves, (region.plane, -region.plane), strict=False):
            side = clipped(corners, plane), np.concatenate([planes, plane[None]])
            open_.append((half, *side))
    return True


def _groups(components: Components) -> list[Components]:
    """Large components each for itself, all others together."""
    count = len(components.closed)
    if count == 1:
        return [components]
    points = components.corners.reshape(-1, 3)
    label = np.repeat(components.label, 3)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, label, points)
    np.maximum.at(high, label, points)
    size = np.linalg.norm(high - low, axis=1)
    largest = np.argsort(-size, kind="stable")[:_APART]
    apart = largest[size[largest] >= _LARGE * np.linalg.norm(np.ptp(points, axis=0))]
    others = np.setdiff1d(np.arange(count), apart)
    groups = [components.of_labels(np.array([k])) for k in apart]
    return [*groups, components.of_labels(others)] if len(others) else groups


def _cut(
    roots: list[CoverRegion], around: MeshSurroundings, reach: float, step: Callable[[], None]
) -> float:
    """Cut regions, what meets most far cells first, until none meets one.

    Args:
        reach: metres beyond which cells are to be far.

    Returns:
        metres beyond which they are: more where it would be too many regions.
    """
    far = around.far(reach)
    number = itertools.count()
    open_: list[tuple[int, int, CoverRegion, Array]] = []

    def look_at(region: CoverRegion, middles: Array | None = None) -> None:
        assert region.piece is not None
        planes = region.piece.hull.planes
        met = far.met(planes) if middles is None else far.met_of(planes, middles)
        if len(met):
            heapq.heappush(open_, (-len(met), next(number), region, met))

    leaves = [leaf for root in roots for leaf in root.leaves()]
    for leaf in leaves:
        look_at(leaf)
    pieces = len(leaves)
    while open_:
        step()
        if pieces < _PIECES:
            _, _, region, met = heapq.heappop(open_)
            assert region.piece is not None
            plane = _best_plane(region.piece, met, far.half)
            if plane is not None and region.cut(plane):
                pieces += 1
                for half in region.halves:
                    look_at(half, met)  # the hull of a half is within that of the whole
                continue
            open_.append((0, next(number), region, met))
        far = around.far(_GROWTH * far.reach)
        left, open_ = open_, []
        for *_, region, _ in left:
            look_at(region)
    return far.reach


def _best_plane(piece: ClippedPiece, met: Array, half: float) -> Array | None:
    """The plane (4,) on whose sides the hulls hold the fewest far cells, about.

    Of those that hold as many one is better that is nearer to the middle and across a longer side:
    it takes several cuts before the pieces of a ring leave its hole free.
    """
    points, cells = _some_points(piece), met[:: 1 + len(met) // _CELLS]
    along, cells_along = points @ _DIRECTIONS.T, cells @ _DIRECTIONS.T
    outward = (_EVENLY @ points.T).astype(np.float32)
    middle = piece.hull.vertices.mean(axis=0)
    axes = np.linalg.svd(piece.hull.vertices - middle, full_matrices=False)[2]
    normals = _unlike([plane_through(axis, 0.0)[:3] for axis in (*np.eye(3), *axes)])
    widths = np.array([np.ptp(points @ normal) for normal in normals])
    shares = np.linspace(0.0, 1.0, _CUTS + 2)[1:-1]
    likely: list[tuple[float, int, float]] = []

    def judged(number: int, share: float) -> tuple[float, int, float]:
        plane = plane_through(normals[number], starts[number] + share * widths[number])
        return _cost(points, outward, plane, cells, half) + askew(number, share), number, share

    def askew(number: int, share: float) -> float:
        return _OFF_MIDDLE * abs(share - 0.5) + _NARROW * float(1.0 - widths[number] / widths.max())

    starts = [float((points @ normal).min()) for normal in normals]
    for number, normal in enumerate(normals):
        if widths[number] < 2.0 * half:
            continue
        order = np.argsort(points @ normal)
        firsts = np.searchsorted(points[order] @ normal, starts[number] + shares * widths[number])
        costs = _rough_costs(along[order], firsts, cells_along)
        costs += [askew(number, share) for share in shares]
        best = int(np.argmin(costs))
        likely.append((float(costs[best]), number, float(shares[best])))
    if not likely:
        return None
    promising = [judged(number, share) for _, number, share in sorted(likely)[:_PROMISING]]
    _, number, share = min(promising)
    near = share + np.linspace(-1.0, 1.0, _NEAR + 2)[1:-1] / (_CUTS + 1)
    cost, number, share = min(promising + [judged(number, float(each)) for each in near])
    plane = plane_through(normals[number], starts[number] + share * widths[number])
    return plane if np.isfinite(cost) else None


def _unlike(normals: list[Array]) -> list[Array]:
    """Those that are no other's, either way round."""
    kept: list[Array] = []
    for normal in normals:
        if all(abs(normal @ other) < 1.0 - _ALIKE for other in kept):
            kept.append(normal)
    return kept


def _cost(points: Array, outward: Floats, plane: Array, cells: Array, half: float) -> float:
    """Share of cells that the hulls of the points on the sides of a plane meet, summed.

    Of points (n, 3) the outermost along directions, how far (d, n) they are along these, stand for
    all: hulls of thousands of points take most of the time that a cover takes.
    """
    above = points @ plane[:3] + plane[3] > 0.0
    if not 4 <= above.sum() <= len(points) - 4:
        return np.inf
    return sum(
        _met_share(hull_around(points[_outermost(side, outward)]), cells, half)
        for side in (above, ~above)
    )


def _outermost(chosen: Mask, outward: Floats) -> Labels:
    """Rows of those of points (n,) that are furthest along a direction (d, n), or against it."""
    ends = [np.where(chosen, outward, -np.inf), np.where(chosen, outward, np.inf)]
    return np.unique([ends[0].argmax(axis=1), ends[1].argmin(axis=1)])


def _met_share(hull: Polytope, cells: Array, half: float) -> float:
    """Share of cells of middles (k, 3) that a hull meets, and a little of how deep they are."""
    reach = half * np.abs(hull.planes[:, :3]).sum(axis=1) - hull.planes[:, 3]
    depth = (reach - cells @ hull.planes[:, :3].T).min(axis=1)
    size = float(np.ptp(hull.vertices, axis=0).max())
    return float((depth > 0.0).mean() + _DEEP * depth.clip(0.0).mean() / size)


def _rough_costs(ranked: Array, firsts: Array, cells: Array) -> Array:
    """(c,) the same of boxes in many directions around the points before and from there on.

    Args:
        ranked: (n, d) points along the directions, in their order along the cut's normal.
        firsts: (c,) rows of the first points beyond each cut.
        cells: (k, d) along the directions.
    """
    costs = np.full(len(firsts), np.inf)
    inner = np.flatnonzero((firsts > 0) & (firsts < len(ranked)))
    beyond, of_cut = np.unique(firsts[inner], return_inverse=True)
    starts = np.concatenate([[0], beyond]).astype(np.intp)
    lows, highs = np.minimum.reduceat(ranked, starts), np.maximum.reduceat(ranked, starts)
    low, high = np.minimum.accumulate(lows), np.maximum.accumulate(highs)
    low_after = np.minimum.accumulate(lows[::-1])[::-1]
    high_after = np.maximum.accumulate(highs[::-1])[::-1]
    for number, k in zip(inner, of_cut, strict=True):
        before = (cells >= low[k]) & (cells <= high[k])
        after = (cells >= low_after[k + 1]) & (cells <= high_after[k + 1])
        costs[number] = before.all(axis=1).mean() + after.all(axis=1).mean()
    return costs


def _some_points(piece: ClippedPiece) -> Array:
    """(n, 3) of its hull's vertices and of its triangles, evenly."""
    sides = np.cross(
        piece.corners[:, 1] - piece.corners[:, 0], piece.corners[:, 2] - piece.corners[:, 0]
    )
    area = 0.5 * float(np.linalg.norm(sides, axis=1).sum())
    size = float(np.linalg.norm(np.ptp(piece.hull.vertices, axis=0)))
    # Slivers have hardly an area, but as many points as others of their length.
    spacing = max(float(np.sqrt(area / _POINTS)), size / _ALONG)
    rng = np.random.default_rng(0)
    corners = piece.corners
    if len(corners) > _POINTS:
        corners = corners[rng.choice(len(corners), _POINTS, replace=False)]
    points = np.concatenate([piece.inner, *surface_points(corners, spacing)])
    if len(points) > _POINTS:
        points = points[rng.choice(len(points), _POINTS, replace=False)]
    corner = piece.hull.vertices
    if len(corner) > _CORNERS:
        along = corner @ _EVENLY.T
        kept = along.argmax(axis=0), along.argmin(axis=0), rng.choice(len(corner), _CORNERS)
        corner = corner[np.unique(np.concatenate(kept))]
    return np.concatenate([points, corner])


@dataclass(frozen=True, slots=True, eq=False)
class _CoverPart:
    """A hull, and the regions whose pieces it holds."""

    hull: Polytope
    leaves: tuple[CoverRegion, ...]

    @property
    def box(self) -> Array:
        """(2, 3) corners of the box around it."""
        return np.stack([self.hull.vertices.min(axis=0), self.hull.vertices.max(axis=0)])


def _joined(
    leaves: Sequence[CoverRegion], around: MeshSurroundings, reach: float, step: Callable[[], None]
) -> tuple[list[_CoverPart], float]:
    """As few parts as joining one pair after the other leaves, small ones first, and how far they
    reach."""
    far = around.far(reach)
    parts = {}
    for number, leaf in enumerate(leaves):
        assert leaf.piece is not None
        parts[number] = _CoverPart(_simpler(leaf.piece.hull, far), (leaf,))
        step()
    while True:
        _join(parts, far, step)
        if len(parts) <= MOST_PARTS:
            break
        far = around.far(_GROWTH * far.reach)
    return [_CoverPart(_simpler(part.hull, far), part.leaves) for part in parts.values()], far.reach


def _simpler(hull: Polytope, far: Far) -> Polytope:
    """One around it with fewer vertices, that holds no far points either, where there is."""
    for share in _SIMPLER:
        made = simpler(hull, share * far.reach, MOST_VERTICES)
        if not far.is_met(made.vertices, made.planes):
            return made
    return hull if len(hull.vertices) <= MOST_VERTICES else made


def _join(parts: dict[int, _CoverPart], far: Far, step: Callable[[], None]) -> None:
    """Join parts, the two with the smallest box around both first, as long as no hull holds far
    points."""
    pairs: list[tuple[float, int, int, int]] = []
    number = itertools.count()

    def consider(one: int, others: Sequence[int]) -> None:
        step()
        if not others:
            return
        boxes = np.array([parts[other].box for other in others])
        low, high = parts[one].box
        gaps = np.maximum(boxes[:, 0], low) - np.minimum(boxes[:, 1], high)
        around = (np.maximum(boxes[:, 1], high) - np.minimum(boxes[:, 0], low)).prod(axis=1)
        for k in np.flatnonzero(gaps.max(axis=1) <= far.reach):
            heapq.heappush(pairs, (float(around[k]), next(number), one, others[int(k)]))

    names = list(parts)
    for row, name in enumerate(names):
        consider(name, names[row + 1 :])
    while pairs:
        _, _, i, j = heapq.heappop(pairs)
        if i not in parts or j not in parts:
            continue
        step()
        both = _both(parts[i], parts[j], far)
        if both is not None:
            del parts[i], parts[j]
            new, others = max([i, j, *parts]) + 1, list(parts)
            parts[new] = both
            consider(new, others)


def _both(a: _CoverPart, b: _CoverPart, far: Far) -> _CoverPart | None:
    """The two as one part; None where their hull holds far points."""
    if far.holds(_between(a, b)):
        return None
    made = hull_around(np.concatenate([a.hull.vertices, b.hull.vertices]))
    if far.is_met(made.vertices, made.planes):
        return None
    return _CoverPart(made, a.leaves + b.leaves)


def _between(a: _CoverPart, b: _CoverPart) -> Array:
    """(n, 3) points between vertices of the two, which a hull of both holds."""
    some, others = (part.hull.vertices[:: 1 + len(part.hull.vertices) // _FROM] for part in (a, b))
    return np.asarray(0.5 * (some[:, None] + others).reshape(-1, 3))


def _hull_or_box(points: Array) -> Array:
    """Vertices (m, 3) of one part that holds all points (n, 3)."""
    with contextlib.suppress(QhullError):
        made = grown(simpler(hull_around(points), 0.0, MOST_VERTICES))
        if holds(made, points):
            return made
    low, high = points.min(axis=0) - 10.0 * ROUNDING, points.max(axis=0) + 10.0 * ROUNDING
    return np.array(list(itertools.product(*np.stack([low, high], axis=1))))


def _excess(
    parts: Sequence[Array], around: MeshSurroundings, reach: float, step: Callable[[], None]
) -> float:
    """Metres, about the least, beyond which no part holds far points; about `reach`."""
    hulls = [hull_around(part) for part in parts]

    def is_enough(reach: float) -> bool:
        step()
        far = around.far(reach)
        return not any(
            far.is_met(part, hull.planes) for part, hull in zip(parts, hulls, strict=True)
        )

    low, high = reach / _GROWTH, reach
    while not is_enough(high) and high < around.size:
        low, high = high, _GROWTH * high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if is_enough(middle) else (middle, high)
    return high
