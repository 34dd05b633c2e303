"""Edges that may lean, the walls for them, and strips of surface before these where they stand.

How an edge leans depends on how far it is from the wall alone. So whether it could stay is looked
up along that distance, once for edges that look alike, and a strip of surface is drawn from that
lies between the distances of its own edges.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from scipy.ndimage import binary_erosion

from placement_planner_ros.core.contacts.coplanarity import MAX_LEAN_SLOPE
from placement_planner_ros.core.contacts.friction_cones import TILT_RAD, could_stay, stays
from placement_planner_ros.core.contacts.lean_edges import SHORTEST_M, LeanEdges
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.scene.walls import Wall
from placement_planner_ros.core.types import Array, Mask, Slope

TOUCHING_M = 2e-4
"""m from the surface and from the wall up to which corners of the hull touch."""
ALIKE_TILT_RAD = 0.2 * TILT_RAD
"""rad by which walls differ before which edges are said to stay alike: little by their reserve."""
STRIP_M = 0.005
"""m, side of the squares that strips of surface before walls are made of."""
STEP_M = 0.2 * STRIP_M
"""m between distances from the wall at which it is looked whether an edge could stay."""


class Lack(IntEnum):
    """What the edge lacked that came nearest to leaning, in the order in which that is asked."""

    ANY_EDGE = 0
    """It would fall away from a wall, roll, or slide to the floor, whatever was asked."""
    EXACT_WALL = 1
    """It would stay before walls that are where they were measured."""
    FRICTION = 2
    """It would stay on rougher surfaces."""
    RESERVE = 3
    """It would stay without `stability_margin`."""
    SURFACE = 4
    """None is as near to a wall."""
    HEIGHT = 5
    """Of the wall."""
    MEASURED = 6
    """At the ends of what touches."""


@dataclass(frozen=True, slots=True)
class Reach:
    """From where an edge leans.

    Attributes:
        nearest, farthest: m from the wall between which it may stay, wherever within the tolerance
            of contacts the wall is.
        touches, touches_below: m above the surface between which the object touches the wall.
        half: m to either side of the edge's middle that it touches along the foot.
        center: m from the wall that the centre of mass is where the edge is nearest, and farthest,
            and from the edge's middle along the foot.
    """

    nearest: float
    farthest: float
    touches: float
    touches_below: float
    half: float
    center: tuple[float, float, float]


class Reaches:
    """From where edges lean on walls, for a surface and a wall that are whole.

    Args:
        center: (3,) of mass, in the object's frame.
        footing: friction, reserve and tolerance with which an edge must stay.
    """

    def __init__(self, edges: LeanEdges, center: Array, footing: SupportSettings) -> None:
        self._edges, self._center, self._footing = edges, center, footing
        placed = [np.vstack([center, edges.corners]) - reference for reference in edges.references]
        turned = [points @ axes.T for points, axes in zip(placed, edges.axes, strict=True)]
        # Edges whose corners and centre lie alike about them are of one shape.
        self._shapes = [
            np.round([points[0], *sorted(points[1:].round(5).tolist())], 5).tobytes()
            for points in turned
        ]
        self._known: dict[int, dict[int, Reach]] = {}

    def before(self, tilt: float) -> dict[int, Reach]:
        """Those of the edges that stay before walls that lean back by about so much."""
        key = round(tilt / ALIKE_TILT_RAD)
        if key not in self._known:
            of_shape: dict[bytes, Reach | None] = {}
            for edge, shape in enumerate(self._shapes):
                if shape not in of_shape:
                    of_shape[shape] = self._reach(edge, key * ALIKE_TILT_RAD)
            of_edges = {edge: of_shape[shape] for edge, shape in enumerate(self._shapes)}
            self._known[key] = {edge: reach for edge, reach in of_edges.items() if reach}
        return self._known[key]

    def lack(self, tilts: Iterable[float]) -> Lack:
        """What edges lack of which none stays before walls that lean back by so much: that with
        which one would."""
        tilts, bare = set(tilts), replace(self._footing, stability_margin=0.0)
        for lack, footing in (
            (Lack.RESERVE, bare),
            (Lack.FRICTION, replace(bare, friction=2.0)),
            (Lack.EXACT_WALL, replace(self._footing, contact_tolerance=0.0)),
        ):
            reaches = Reaches(self._edges, self._center, footing)
            if any(reaches.before(tilt) for tilt in tilts):
                return lack
        return Lack.ANY_EDGE

    def _reach(self, edge: int, tilt: float) -> Reach | None:
        edges, footing = self._edges, self._footing
        farthest = np.linalg.norm(edges.corners - edges.references[edge], axis=1).max()
        distances = np.arange(STEP_M, farthest / math.cos(tilt), STEP_M)
        turns = edges.turns(np.full(len(distances), edge), distances, np.full(len(distances), tilt))
        distances, turns = distances[np.isfinite(turns)], turns[np.isfinite(turns)]
        # The corners at each distance, with the edge's middle at the origin.
        R = edges.rotations(np.full(len(turns), edge), turns)
        corners = (edges.corners - edges.references[edge]) @ R.transpose(0, 2, 1)
        centers = R @ (self._center - edges.references[edge])
        near = corners[..., 0] * math.cos(tilt) + corners[..., 2] * math.sin(tilt)
        against = near <= near.min(axis=1, keepdims=True) + TOUCHING_M
        lowest = np.where(against, corners[..., 2], np.inf).min(axis=1, initial=np.inf)
        highest = np.where(against, corners[..., 2], -np.inf)
        top = corners[np.arange(len(R)), highest.argmax(axis=1)] if len(R) else centers
        # Where it does not fall away from the wall, and touches it high enough, by a length: on one
        # corner alone it turns. Falling against it by an error its centre moves more towards it
        # than down: else what is short slides to the floor, however rough that is, as nothing
        # presses its foot then. And friction may hold it, and would if the wall were off.
        long = touched_length(corners[..., 1], near) >= SHORTEST_M
        may = long & (lowest >= least_lever(footing)) & (-centers[:, 0] <= centers[:, 2])
        planar = centers[:, [0, 2]], top[:, [0, 2]], tilt
        may &= could_stay(*planar, footing.friction, footing.stability_margin)
        off = math.ceil(footing.contact_tolerance / STEP_M)
        rows = np.flatnonzero(binary_erosion(may, np.ones(2 * off + 1)))
        # It does at some of these distances.
        for row in rows[[len(rows) // 2, 0, -1]] if len(rows) else rows:
            floor = corners[row][corners[row][:, 2] <= corners[row][:, 2].min() + TOUCHING_M]
            if is_held(floor, corners[row][against[row]], tilt, centers[row], footing):
                ends = rows[[0, -1]]
                away = distances[ends] + centers[ends, 0]
                return Reach(
                    nearest=float(distances[rows[0]]),
                    farthest=float(distances[rows[-1]]),
                    touches=float(lowest[rows].min()),
                    touches_below=float(lowest[rows].max()),
                    half=float(np.abs(corners[row][against[row], 1]).max()),
                    center=(float(away[0]), float(away[1]), float(centers[row, 1])),
                )
        return None


def touched_length(along: Array, near: Array) -> Array:
    """(n,) m from one end to the other of what bears on a wall, of corners (n, k) along its foot
    and so far from it: the nearest, and those that touch it, too, once the object has turned by no
    more than things on a surface may lean."""
    aside = along - np.take_along_axis(along, near.argmin(axis=1)[:, None], axis=1)
    beyond = near - near.min(axis=1, keepdims=True)
    bears = beyond <= TOUCHING_M + MAX_LEAN_SLOPE * np.abs(aside)
    return np.asarray(np.ptp(np.where(bears, aside, 0.0), axis=1))


def least_lever(footing: SupportSettings) -> float:
    """m above the surface at which a wall is touched at least: where it is off by the tolerance the
    object turns by no more than its reserve."""
    return footing.contact_tolerance / math.tan(TILT_RAD)


def is_held(
    floor: Array, against: Array, tilt: float, center: Array, footing: SupportSettings
) -> bool:
    """Whether friction cones at points on surface and wall bear the weight with its reserve, in
    axes out of the wall, along its foot, and up."""
    inset = footing.contact_tolerance
    floor, against = _drawn_in(floor, inset), _drawn_in(against, inset)
    return stays(floor, against, tilt, center, footing.friction, footing.stability_margin)


def _drawn_in(points: Array, tolerance: float) -> Array:
    """(k, 3) points of which those at the ends along the foot are moved inwards by the tolerance,
    as what carries them may end there."""
    low, high = points[:, 1].min(), points[:, 1].max()
    inset = min(tolerance, 0.5 * (high - low))
    moved = np.clip(points[:, 1], low + inset, high - inset)
    return np.column_stack([points[:, 0], moved, points[:, 2]])


class Strips:
    """Surface of V before walls, in squares.

    Attributes:
        lack: what there was none of for the edge that came nearest to leaning.
        lowest: m, how high a wall that is too low is above a surface, and how high the object
            would touch it; of all that it lacks least.
    """

    def __init__(self, environment: Environment, footing: SupportSettings) -> None:
        self._environment, self._footing = environment, footing
        self._squares = functools.cache(self._with_surface)
        self.lack = Lack.ANY_EDGE
        self.lowest = (-math.inf, 0.0)

    def before(
        self, wall: Wall, surfaces: Iterable[Region], reaches: Collection[Reach]
    ) -> list[tuple[Region, Reach]]:
        """One for each reach, and each of some surfaces that was measured there."""
        low, high = wall.extent[:, 0]
        spread = 0.5 * STRIP_M * np.abs(wall.outward).sum()  # of a square, towards the wall
        found = []
        for surface in surfaces:
            rise = rise_above(surface, wall)
            if rise <= self._footing.contact_tolerance or not reaches:  # a surface's own side
                continue
            farthest = max(reach.farthest for reach in reaches)
            squares, middles = self._squares(surface)
            away = wall.foot_distance(middles)
            rows = np.flatnonzero((away > 0.0) & (away <= farthest + STRIP_M))
            squares, middles, away = squares[rows], middles[rows], away[rows]
            along = middles @ wall.rotation[0]
            for reach in reaches:
                # Squares as near as it stays, with all of them where there is room for that.
                inset = min(spread, 0.5 * (reach.farthest - reach.nearest - STRIP_M))
                near = (away >= reach.nearest + inset) & (away <= reach.farthest - inset)
                near &= (along >= low) & (along <= high)
                wide = (along >= low + reach.half) & (along <= high - reach.half)
                rows = np.flatnonzero(near & wide)
                if not near.any():
                    lack = Lack.SURFACE
                elif reach.touches > rise:
                    lack = Lack.HEIGHT
                    self.lowest = max(self.lowest, (rise, reach.touches), key=lambda x: x[0] - x[1])
                else:
                    inside = self._has_center(wall, reach, middles[rows], away[rows])
                    lack = Lack.SURFACE if len(rows) and not inside.any() else Lack.MEASURED
                    rows = rows[inside]
                    rows = rows[self._has_ends(wall, surface, reach, middles[rows])]
                    if len(rows):
                        found.append((replace(surface, rectangles=squares[rows]), reach))
                self.lack = max(self.lack, lack)
        return found

    def _has_center(self, wall: Wall, reach: Reach, middles: Array, away: Array) -> Mask:
        """(n,) whether the centre of mass is in V with the middle of the edge at (n, 3)."""
        *ends, along = reach.center
        moved = np.interp(away, (reach.nearest, reach.farthest), ends) - away
        centers = middles + along * wall.rotation[0]
        centers[:, :2] += moved[:, None] * wall.outward
        return self._environment.volume.contains(centers)

    def _has_ends(self, wall: Wall, surface: Region, reach: Reach, middles: Array) -> Mask:
        """(n,) whether surface and wall are there, up to half a square, at both ends of what
        touches, with the middle of the edge at (n, 3)."""
        tolerance, margin = self._footing.contact_tolerance, self._footing.edge_margin
        half = max(reach.half - math.sqrt(0.5) * STRIP_M, 0.0)
        ends = middles + np.array([-half, half])[:, None, None] * wall.rotation[0]
        ends[..., 2] = surface.heights(ends[..., :2])
        support = self._environment.support_of(surface.slope)
        found = support.supported(ends.reshape(-1, 3), tolerance)
        rows = np.flatnonzero(found.reshape(2, -1).all(axis=0))
        result = np.zeros(len(middles), np.bool_)
        if not len(rows):
            return result
        # The wall at the least, or at the greatest height at which it is touched.
        heights = np.array([reach.touches, reach.touches_below])[:, None, None]
        against = np.empty((2, 2, len(rows), 3))
        against[..., 0] = ends[:, rows] @ wall.rotation[0]
        above = ends[:, rows, 2] + heights - wall.offset * wall.normal[2]
        against[..., 1], against[..., 2] = above / wall.rotation[1, 2], wall.offset
        touched = wall.support.supported(against.reshape(-1, 3), tolerance, margin)
        result[rows] = touched.reshape(2, 2, -1).any(axis=0).all(axis=0)
        return result

    def _with_surface(self, surface: Region) -> tuple[Array, Array]:
        """(k, 4) squares with surface in its plane, their middles in V, and (k, 3) these."""
        volume = self._environment.volume
        first = np.floor(volume.lower[:2] / STRIP_M)
        count = (np.ceil(volume.upper[:2] / STRIP_M) - first).astype(np.int64)
        corners = (first + np.indices(count.tolist()).reshape(2, -1).T) * STRIP_M
        middles = corners + 0.5 * STRIP_M
        middles = np.column_stack([middles, surface.heights(middles)])
        rows = np.flatnonzero(volume.contains(middles))
        tolerance = self._footing.contact_tolerance
        support = self._environment.support_of(surface.slope)
        rows = rows[support.supported(middles[rows], tolerance)]
        return np.hstack([corners[rows], corners[rows] + STRIP_M]), middles[rows]


def rise_above(surface: Region, wall: Wall) -> float:
    """m from a surface up to a wall's top, in the middle of its foot."""
    return wall.top - float(surface.heights(wall.corners[:, :2]).mean())


def distinct_surfaces(regions: Iterable[Region], tolerance: float) -> dict[Slope, list[Region]]:
    """One region of each plane that there is, by slope; of those that differ in height by no more
    than a tolerance the largest."""
    found: dict[Slope, list[Region]] = {}
    for region in regions:
        alike = found.setdefault(region.slope, [])
        if all(abs(region.z - each.z) > tolerance for each in alike):
            alike.append(region)
    return found
