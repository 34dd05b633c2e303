"""An edge of the object on a surface, the object against a wall: the second contact class.

A feature is an edge of the hull with one side of one wall. Its reference point, the middle of the
edge, is placed on the surface before the wall, where the edge runs along the wall's foot: so the
place along the foot and the distance from it are what is free, and the distance says by how much
the object leans. Where the surface is off level, up is out of it.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.collision.against_boxes import BoxArrays
from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.collision.object import ObjectCollision
from placement_planner_ros.core.contacts.contact_class import Missing
from placement_planner_ros.core.contacts.coplanarity import MAX_LEAN_SLOPE
from placement_planner_ros.core.contacts.lean_edges import SHORTEST_M, lean_edges
from placement_planner_ros.core.contacts.lean_features import (
    TOUCHING_M,
    Lack,
    Reach,
    Reaches,
    Strips,
    distinct_surfaces,
    is_held,
    least_lever,
    rise_above,
    touched_length,
)
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.rasters import TILE_M
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.scene.support import SupportMap
from placement_planner_ros.core.scene.walls import STEEPEST_LEAN_RAD
from placement_planner_ros.core.search.hierarchy import Ranges
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import (
    FULL_TURN,
    Array,
    Contact,
    Index,
    Mask,
    Resting,
    Slope,
    upright,
)

ANY_ANGLE: Ranges = ((0.0, FULL_TURN / 256),)
"""The wall says how the object is turned: one short range that is not divided."""


class LeanContact:
    """Edges of the object on surfaces, against walls.

    Args:
        collision: c_f(x)'s margin, and how far from what carries it the object may be.
    """

    def __init__(
        self, problem: Problem, footing: SupportSettings, collision: CollisionSettings
    ) -> None:
        self._footing, self._body = footing, problem.body
        self._environment = problem.environment
        self._collision = ObjectCollision(problem.body, problem.environment.obstacles, collision)
        self._edges = lean_edges(problem.body.vertices)
        self._reaches = Reaches(self._edges, problem.body.center_of_mass, footing)
        self._strips = Strips(problem.environment, footing)
        tolerance = footing.contact_tolerance
        surfaces = distinct_surfaces(problem.environment.regions, tolerance)
        # Each wall once for every slope of surfaces above which it rises: what ends at a surface,
        # to half a tile, is that surface's own side.
        before = [
            (wall, slope)
            for wall in problem.environment.walls
            for slope, alike in surfaces.items()
            if max(rise_above(each, wall) for each in alike) > tolerance + 0.5 * TILE_M
        ]
        self._no_surface, self._walls = not surfaces, [wall for wall, _ in before]
        self._slopes = np.array([slope for _, slope in before]).reshape(-1, 2)
        self._boxes = functools.cache(self._boxes_before)
        # The planes, and axes out of each wall along its surface, along its foot, and up.
        self._planes = np.array([[*w.normal, -w.offset] for w in self._walls]).reshape(-1, 4)
        up, normals = upright(self._slopes)[:, :, 2], self._planes[:, :3]
        along = np.cross(up, normals)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        self._frames = np.stack([np.cross(along, up), along, up], axis=2)
        self._tilts = np.arcsin((normals * up).sum(axis=1))
        self._openings = normals + up
        self._openings /= np.linalg.norm(self._openings, axis=1, keepdims=True)
        # Each feature is an edge with a wall and how it leans there; strips are for some of these.
        self._regions: dict[Region, tuple[int, Reach]] = {}
        self._features: list[tuple[int, Reach]] = []
        edges: list[int] = []
        for number, (wall, slope) in enumerate(before):
            reaches = self._reaches.before(float(self._tilts[number]))
            strips = self._strips.before(wall, surfaces[slope], dict.fromkeys(reaches.values()))
            self._regions |= {strip: (number, reach) for strip, reach in strips}
            used = {reach for _, reach in strips}
            own = [(edge, reach) for edge, reach in reaches.items() if reach in used]
            edges += [edge for edge, _ in own]
            self._features += [(number, reach) for _, reach in own]
        # The same as arrays.
        self._edge_of = np.array(edges, np.int64)
        self._wall_of = np.array([wall for wall, _ in self._features], np.int64)
        ends = [(reach.nearest, reach.farthest) for _, reach in self._features]
        self._ends = np.array(ends).reshape(-1, 2)
        self.references = self._edges.references[self._edge_of]
        self.frames: tuple[pin.SE3 | None, ...] = (None,) * len(edges)

    @property
    def regions(self) -> tuple[Region, ...]:
        """Strips of surface before walls."""
        return tuple(self._regions)

    def ranges(self, feature: int, region: Region) -> Ranges:
        """A feature belongs before its own wall, as far from it as it stays."""
        return ANY_ANGLE if self._regions[region] == self._features[feature] else ()

    def _distances(self, features: Index, points: Array) -> Array:
        """(n,) m of points (n, 3) from the walls of features, along surfaces before these."""
        planes = self._planes[self._wall_of[features]]
        away = (points * planes[:, :3]).sum(axis=1) + planes[:, 3]
        return np.asarray(away / np.cos(self._tilts[self._wall_of[features]]))

    def poses(self, features: Index, points: Array, angles: Array, slopes: Array | None) -> Array:
        """(n, 4, 4) with the middle of the edge at each point; where it cannot touch the wall from
        there, as it lies on the facet away from it."""
        edges, walls = self._edge_of[features], self._wall_of[features]
        turns = self._edges.turns(edges, self._distances(features, points), self._tilts[walls])
        T = np.tile(np.eye(4), (len(features), 1, 1))
        T[:, :3, :3] = self._frames[walls] @ self._edges.rotations(edges, np.nan_to_num(turns))
        T[:, :3, 3] = points - np.einsum("nij,nj->ni", T[:, :3, :3], self.references[features])
        return T

    def stable(self, T: Array, features: Index, slope: Slope) -> Mask:
        """(n,) what touches is measured surface, as far from the wall as the edge may stay."""
        feet = np.einsum("nij,nj->ni", T[:, :3, :3], self.references[features]) + T[:, :3, 3]
        distances, ends = self._distances(features, feet), self._ends[features]
        result = np.asarray((distances >= ends[:, 0]) & (distances <= ends[:, 1]))
        rows = np.flatnonzero(result)
        if len(rows):
            result[rows] = self._on_surfaces(T[rows], features[rows], slope)
        return result

    def _on_surfaces(self, T: Array, features: Index, slope: Slope) -> Mask:
        """(n,) whether what touches is measured surface."""
        corners, floor, against = self._touching(T, features)
        walls = self._wall_of[features]
        along = (corners * self._frames[walls][:, None, :, 1]).sum(axis=2)
        near = (corners * self._planes[walls][:, None, :3]).sum(axis=2)
        result = (floor.sum(axis=1) >= 2) & (touched_length(along, near) >= SHORTEST_M)
        # Measured surface under all that touches, on the floor and on each wall.
        rows = np.flatnonzero(result)
        support = self._environment.support_of(slope)
        result[rows] = self._carried(support, corners[rows], floor[rows], along[rows])
        for wall in np.unique(walls[result]):
            rows = np.flatnonzero(result & (walls == wall))
            own = self._walls[wall]
            turned = corners[rows] @ own.rotation.T
            result[rows] = self._carried(own.support, turned, against[rows], along[rows])
        return result

    def held(self, T: Array, features: Index) -> Mask:
        """(n,) friction cones at what touches bear the weight."""
        corners, floor, against = self._touching(T, features)
        centers = T[:, :3, :3] @ self._body.center_of_mass + T[:, :3, 3]
        result = np.zeros(len(T), np.bool_)
        for row, wall in enumerate(self._wall_of[features]):
            step("looking which leaning poses friction holds")
            # In axes of the wall's foot, in which the weight is aside by the slope.
            aside = self._footing.stability_margin + float(np.hypot(*self._slopes[wall]))
            footing = replace(self._footing, stability_margin=aside)
            frame, tilt = self._frames[wall], float(self._tilts[wall])
            under, behind = (corners[row][on[row]] @ frame for on in (floor, against))
            lever = behind[:, 2].min() - under[:, 2].mean()
            result[row] = lever >= least_lever(footing) and is_held(
                under, behind, tilt, centers[row] @ frame, footing
            )
        return result

    def _touching(self, T: Array, features: Index) -> tuple[Array, Mask, Mask]:
        """(n, k, 3) corners in the world, (n, k) which are on the surface and which on the wall."""
        corners = self._edges.corners @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]
        walls = self._wall_of[features]
        planes, heights = self._planes[walls], corners @ self._frames[walls][:, :, 2:]
        low = (heights - heights.min(axis=1, keepdims=True))[..., 0]
        near = np.einsum("nkj,nj->nk", corners, planes[:, :3]) + planes[:, 3:]
        return corners, low <= TOUCHING_M, near <= TOUCHING_M

    def _carried(self, support: SupportMap, points: Array, touching: Mask, along: Array) -> Mask:
        """(n,) whether surface was measured under all points (n, k, 3) that touch, and leans no
        more from one to another along the foot, where they are at (n, k), than an object may."""
        footing = self._footing
        gaps = np.full(touching.shape, np.nan)
        gaps[touching] = support.gaps(
            points[touching], footing.contact_tolerance, footing.edge_margin
        )
        rows = np.arange(len(gaps))
        first = np.where(touching, along, np.inf).argmin(axis=1)
        last = np.where(touching, along, -np.inf).argmax(axis=1)
        length = along[rows, last] - along[rows, first]
        off = np.abs(gaps[rows, last] - gaps[rows, first])
        level = off <= MAX_LEAN_SLOPE * length + support.height_noise
        return np.asarray(level & (np.isfinite(gaps) | ~touching).all(axis=1))

    def free(self, T: Array, features: Index, heights: Array, raised: float, slope: Slope) -> Mask:
        """(n,) c_f(x), on the whole way up and away from the wall; what is behind the wall's plane,
        or below the surface's, is what the object leans on."""
        found = np.zeros(len(T), np.bool_)
        for k, (pose, number, height) in enumerate(zip(T, features, heights, strict=True)):
            step("looking which leaning poses are free")
            boxes = self._boxes(int(self._wall_of[number]), float(height), slope)
            found[k] = self._collision.free_along(pose, self.opening(number), raised, boxes)
        return found

    def _boxes_before(self, wall: int, height: float, slope: Slope) -> BoxArrays:
        """The obstacle set; what is of a wall, or of a surface, may be touched."""
        obstacles, tolerance = self._environment.obstacles, self._footing.contact_tolerance
        behind, tops = self._walls[wall].is_behind(obstacles, tolerance), obstacles.tops(slope)
        leant_on = ((tops <= height + tolerance) | behind) & ~np.isinf(tops)
        return self._collision.boxes_touching(leant_on)

    def opening(self, feature: int) -> Array:
        """(3,) between up and out of the wall."""
        return np.asarray(self._openings[self._wall_of[feature]])

    def moved(self, T_world_object: pin.SE3, contact: Contact, change: Array) -> pin.SE3 | None:
        """The middle of the edge moved on its surface, the object against the wall again."""
        number, wall = np.array([contact.feature]), self._wall_of[contact.feature]
        point = T_world_object.act(self.references[contact.feature])[None]
        point[0] += (*change[:2], float(self._slopes[wall] @ change[:2]))
        tilt = self._tilts[[wall]]
        distance = self._distances(number, point)
        if not np.isfinite(self._edges.turns(self._edge_of[number], distance, tilt)).all():
            return None
        return pin.SE3(self.poses(number, point, np.zeros(1), None)[0])

    def excluded(self, features: Index, heights: Array, low: Array, high: Array) -> Mask:
        """(n,) boxes all of which is nearer to the wall, or farther, than where the edge stays."""
        walls, half = self._wall_of[features], 0.5 * (high - low)[:, :2]
        slopes, middles = self._slopes[walls], 0.5 * (low + high)
        middles[:, 2] = heights + (middles[:, :2] * slopes).sum(axis=1)
        # a box reaches so much nearer than its middle, and farther
        out = self._frames[walls][:, :, 0]
        spread = (half * np.abs(out[:, :2] + out[:, 2:] * slopes)).sum(axis=1)
        away, ends = self._distances(features, middles), self._ends[features]
        return np.asarray((away + spread < ends[:, 0]) | (away - spread > ends[:, 1]))

    def resting(self, T_world_object: pin.SE3, feature: int) -> Resting:
        """On corners on the surface, and on the wall, by where that is and where it faces."""
        corners, low, near = self._touching(T_world_object.homogeneous[None], np.array([feature]))
        floor, against = corners[0][low[0]], corners[0][near[0]]
        wall, up = self._walls[of_wall := self._wall_of[feature]], self._frames[of_wall][:, 2]
        normals = [np.tile(n, (len(of), 1)) for n, of in ((up, floor), (wall.normal, against))]
        return Resting(
            "lean",
            f"the {wall}",
            np.vstack([floor, against]),
            np.vstack(normals),
            np.repeat([self._footing.friction, 0.0], [len(floor), len(against)]),
            wall.corners,
        )

    def missing(self) -> Missing | None:
        """The first that there is none of: a surface, an edge, a wall, an edge that stays
        before it, a surface there, a wall that is high enough."""
        if self._features:
            return None
        if self._no_surface:
            return Missing("there is no surface in `volume`", "volume", "choose one with a surface")
        if not len(self._edges):
            words = f"no edge of the object's hull is {1000 * SHORTEST_M:g} mm long to stand on"
            return Missing(words, "body", "check it and `scale`")
        if not self._walls:
            words = "no wall was found in or around `volume` to lean on"
            steep = f"{math.degrees(STEEPEST_LEAN_RAD):g} degrees off upright at most"
            return Missing(words, "volume", f"choose one before a wall, {steep}")
        return self._lacking()[self._strips.lack or self._reaches.lack(self._tilts.tolist())]

    def _lacking(self) -> dict[Lack, Missing]:
        """What is said of each."""
        footing, (rise, touches) = self._footing, self._strips.lowest
        return {
            Lack.ANY_EDGE: Missing(
                "no edge of the object stays before a wall, however rough the surface: it would "
                "roll, tip, fall away, touch the wall by one corner or too low, or slide down",
                "body",
                "check it and `scale`",
            ),
            Lack.EXACT_WALL: Missing(
                "edges would stay only before walls that are off by less than contact_tolerance "
                f"{footing.contact_tolerance:g}",
                "contact_tolerance",
                "lower it, if clouds are that exact",
            ),
            Lack.FRICTION: Missing(
                f"leaning on a wall no edge stays with friction {footing.friction:g} and "
                f"stability_margin {footing.stability_margin:g}",
                "friction",
                "raise it, if surfaces are rougher, lower stability_margin or `center_of_mass`",
            ),
            Lack.RESERVE: Missing(
                f"no edge stays with stability_margin {footing.stability_margin:g}, but with 0",
                "stability_margin",
                "lower it",
            ),
            Lack.SURFACE: Missing(
                "no surface in `volume` is as near to a wall as an edge would have to stand",
                "volume",
                "extend it to where floor and wall meet",
            ),
            Lack.HEIGHT: Missing(
                f"walls are too low: the highest is {rise:.3f} m above a surface before it, and "
                f"the object would touch it at {touches:.3f} m or more",
                "volume",
                "choose one before a higher wall",
            ),
            Lack.MEASURED: Missing(
                "surface or wall ends, or was not seen, where the ends of an edge would touch them",
                "volume",
                "choose one before a wider wall, or one that is known, or seen whole",
            ),
        }
