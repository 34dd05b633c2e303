"""Edges that may lean, the walls for them, and strips of surface before these where they stand.

How an edge leans depends on how far it is from the wall alone. So whether it could stay is looked
up along that distance, once for edges that look alike, and a strip of surface is drawn from that
lies between the distances of its own edges.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from scipy.ndimage import binary_erosion

from placement_planner_ros.core.contacts.friction_cones import TILT_RAD, could_stay, stays
from placement_planner_ros.core.contacts.lean_edges import LeanEdges
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.scene.walls import Wall
from placement_planner_ros.core.types import LEVEL, Array, Mask

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

    LONG_EDGE = 0
    """It would fall away from a wall, roll, or slide to the floor, whatever the friction."""
    LEVER = 1
    """It would touch a wall too low."""
    FRICTION = 2
    LENGTH = 3
    """It would tip over the ends of the edge."""
    SURFACE = 4
    """None is as near to a wall."""
    HEIGHT = 5
    """Of the wall."""
    WIDTH = 6
    """Of the wall."""
    MEASURED = 7
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

    Attributes:
        lack: what edges lack where none stays.
        highest: m above a surface at which an edge touches a wall at most, as far as was asked.
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
        self.lack = Lack.LONG_EDGE
        self.highest = 0.0

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
        # Where it does not fall away from the wall, and touches it high enough. Falling against it
        # by an error its centre moves more towards it than down: else what is short slides to the
        # floor, however rough that is, as nothing presses its foot then.
        planar = centers[:, [0, 2]], top[:, [0, 2]], tilt
        upright = could_stay(*planar, math.inf, footing.stability_margin)
        upright &= -centers[:, 0] <= centers[:, 2]
        high = upright & (lowest >= least_lever(footing))
        self.highest = max(self.highest, lowest[upright].max(initial=0.0))
        # Where friction may hold it in the plane across the foot, and would if the wall were off.
        off = math.ceil(footing.contact_tolerance / STEP_M)
        may = high & could_stay(*planar, footing.friction, footing.stability_margin)
        rows = np.flatnonzero(binary_erosion(may, np.ones(2 * off + 1)))
        passed = bool(upright.any()), bool(high.any()), len(rows) > 0
        curable = len(rows) == 0
        # It does at some of these distances.
        for row in rows[[len(rows) // 2, 0, -1]] if len(rows) else rows:
            floor = corners[row][corners[row][:, 2] <= corners[row][:, 2].min() + TOUCHING_M]
            touching = floor, corners[row][against[row]], tilt, centers[row]
            if is_held(*touching, footing):
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
            # what tilted gravity alone takes over the ends of the edge no setting holds
            curable = curable or is_held(*touching, replace(footing, stability_margin=0.0))
        self.lack = max(self.lack, Lack(sum(passed)) if curable else Lack.LONG_EDGE)
        return None


def least_lever(footing: SupportSettings) -> float:
    """m above the surface at which a wall is touched at least: where it is off by the tolerance the
    object turns by no more than its reserve."""
    return footing.contact_tolerance / math.tan(TILT_RAD)


def is_held(
    floor: Array, against: Array, tilt: float, center: Array, footing: SupportSettings
) -> bool:
    """Whether friction cones at points on surface and wall bear the weight with its reserve, in
    axes out of the wall, along its foot, and up."""
    return stays(
        _drawn_in(floor, footing.contact_tolerance),
        _drawn_in(against, footing.contact_tolerance),
        tilt,
        center,
        footing.friction,
        footing.stability_margin,
    )


def _drawn_in(points: Array, tolerance: float) -> Array:
    """(k, 3) points of which those at the ends along the foot are moved inwards by the tolerance,
    as what carries them may end there."""
    low, high = points[:, 1].min(), points[:, 1].max()
    half = max(0.5 * (high - low) - tolerance, 0.0)
    moved = points.copy()
    moved[:, 1] = np.clip(points[:, 1], 0.5 * (low + high) - half, 0.5 * (low + high) + half)
    return moved


class Strips:
    """Surface of V before walls, in squares.

    Args:
        heights: m, of level surfaces.

    Attributes:
        lack: what there was none of for the edge that came nearest to leaning.
        lowest: m, how high a wall that is too low is above a surface, and how high the object
            would touch it; of all that it lacks least.
    """

    def __init__(
        self, environment: Environment, heights: Sequence[float], footing: SupportSettings
    ) -> None:
        self._environment, self._heights = environment, heights
        self._footing = footing
        self._squares = functools.cache(self._with_surface)
        self.lack = Lack.LONG_EDGE
        self.lowest = (-math.inf, 0.0)

    def before(
        self, wall: Wall, reaches: Collection[Reach], *, too_low: bool = False
    ) -> list[tuple[Region, Reach]]:
        """One for each reach, and each height at which surface was measured there.

        Args:
            too_low: `lack` is told of those, too, that touch the wall above its top.
        """
        low, high = wall.extent[:, 0]
        spread = 0.5 * STRIP_M * np.abs(wall.outward).sum()  # of a square, towards the wall
        found = []
        for height in self._heights:
            rise = wall.top - height
            wanted = [reach for reach in reaches if too_low or reach.touches <= rise]
            if rise <= self._footing.contact_tolerance or not wanted:  # a surface's own side
                continue
            farthest = max(reach.farthest for reach in wanted)
            squares, middles = self._squares(height)
            away = wall.foot_distance(middles)
            rows = np.flatnonzero((away > 0.0) & (away <= farthest + STRIP_M))
            squares, middles, away = squares[rows], middles[rows], away[rows]
            along = middles @ wall.rotation[0]
            for reach in wanted:
                # Squares as near as it stays, with all of them where there is room for that.
                inset = min(spread, 0.5 * (reach.farthest - reach.nearest - STRIP_M))
                near = (away >= reach.nearest + inset) & (away <= reach.farthest - inset)
                near &= (along >= low) & (along <= high)
                wide = near & (along >= low + reach.half) & (along <= high - reach.half)
                rows = np.flatnonzero(wide)
                if not near.any():
                    lack = Lack.SURFACE
                elif reach.touches > rise:
                    lack = Lack.HEIGHT
                    self.lowest = max(self.lowest, (rise, reach.touches), key=lambda x: x[0] - x[1])
                elif not len(rows):
                    lack = Lack.WIDTH
                else:
                    rows = rows[self._has_center(wall, reach, middles[rows], away[rows])]
                    lack = Lack.MEASURED if len(rows) else Lack.SURFACE
                    rows = rows[self._has_ends(wall, reach, middles[rows])]
                    if len(rows):
                        found.append((Region(squares[rows], height), reach))
                self.lack = max(self.lack, lack)
        return found

    def _has_center(self, wall: Wall, reach: Reach, middles: Array, away: Array) -> Mask:
        """(n,) whether the centre of mass is in V with the middle of the edge at (n, 3)."""
        *ends, along = reach.center
        moved = np.interp(away, (reach.nearest, reach.farthest), ends) - away
        centers = middles + along * wall.rotation[0]
        centers[:, :2] += moved[:, None] * wall.outward
        return self._environment.volume.contains(centers)

    def _has_ends(self, wall: Wall, reach: Reach, middles: Array) -> Mask:
        """(n,) whether surface and wall are there, up to half a square, at both ends of what
        touches, with the middle of the edge at (n, 3)."""
        tolerance, margin = self._footing.contact_tolerance, self._footing.edge_margin
        half = max(reach.half - math.sqrt(0.5) * STRIP_M, 0.0)
        ends = middles + np.array([-half, half])[:, None, None] * wall.rotation[0]
        found = self._environment.support.supported(ends.reshape(-1, 3), tolerance)
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

    def _with_surface(self, height: float) -> tuple[Array, Array]:
        """(k, 4) squares with surface at a height, their middles in V, and (k, 3) these."""
        volume = self._environment.volume
        first = np.floor(volume.lower[:2] / STRIP_M)
        count = (np.ceil(volume.upper[:2] / STRIP_M) - first).astype(np.int64)
        corners = (first + np.indices(count.tolist()).reshape(2, -1).T) * STRIP_M
        middles = np.column_stack([corners + 0.5 * STRIP_M, np.full(len(corners), height)])
        rows = np.flatnonzero(volume.contains(middles))
        tolerance = self._footing.contact_tolerance
        rows = rows[self._environment.support.supported(middles[rows], tolerance)]
        return np.hstack([corners[rows], corners[rows] + STRIP_M]), middles[rows]


def distinct_heights(regions: Iterable[Region], tolerance: float) -> list[float]:
    """z of level regions; those that differ by no more than a tolerance once, of the larger."""
    found: list[float] = []
    for region in regions:
        if region.slope == LEVEL and all(abs(region.z - z) > tolerance for z in found):
            found.append(region.z)
    return found
