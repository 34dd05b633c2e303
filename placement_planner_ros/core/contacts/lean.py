"""An edge of the object on a level surface, the object against a wall: the second contact class.

A feature is an edge of the hull with one side of one wall. Its reference point, the middle of the
edge, is placed on the surface before the wall, where the edge runs along the wall's foot: so the
place along the foot and the distance from it are what is free, and the distance says by how much
the object leans.
"""

from __future__ import annotations

import functools
import math

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
    distinct_heights,
    is_held,
    least_lever,
)
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.rasters import TILE_M
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.scene.support import SupportMap
from placement_planner_ros.core.scene.walls import STEEPEST_LEAN_RAD, Wall
from placement_planner_ros.core.search.hierarchy import Ranges
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import (
    FULL_TURN,
    LEVEL,
    Array,
    Contact,
    Index,
    Mask,
    Resting,
    Slope,
)

ANY_ANGLE: Ranges = ((0.0, FULL_TURN / 256),)
"""The wall says how the object is turned: one short range that is not divided."""


class LeanContact:
    """Edges of the object on level surfaces, against walls.

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
        self._heights = distinct_heights(problem.environment.regions, footing.contact_tolerance)
        self._strips = Strips(problem.environment, self._heights, footing)
        tolerance, lowest = footing.contact_tolerance, min(self._heights, default=math.inf)
        # what ends at a surface, to half a tile, is that surface's own side
        above = lowest + tolerance + 0.5 * TILE_M
        self._walls = [w for w in problem.environment.walls if w.top > above]
        self._behind = functools.cache(
            lambda wall: self._walls[wall].is_behind(problem.environment.obstacles, tolerance)
        )
        self._touchable: dict[tuple[int, float], BoxArrays] = {}
        # Each feature is an edge with a wall and how it leans there; strips are for some of these.
        self._regions: dict[Region, tuple[int, Reach]] = {}
        self._features: list[tuple[int, Reach]] = []
        edges: list[int] = []
        for number, wall in enumerate(self._walls):
            reaches = self._reaches.before(wall.tilt)
            strips = self._strips.before(wall, dict.fromkeys(reaches.values()))
            self._regions |= {strip: (number, reach) for strip, reach in strips}
            used = {reach for _, reach in strips}
            own = [(edge, reach) for edge, reach in reaches.items() if reach in used]
            edges += [edge for edge, _ in own]
            self._features += [(number, reach) for _, reach in own]
        # The same as arrays, of features and of walls.
        self._edge_of = np.array(edges, np.int64)
        self._wall_of = np.array([wall for wall, _ in self._features], np.int64)
        ends = [(reach.nearest, reach.farthest) for _, reach in self._features]
        self._ends = np.array(ends).reshape(-1, 2)
        self._tilts = np.array([wall.tilt for wall in self._walls])
        # axes horizontally out of each wall, along its foot, and up; and the plane
        frames = [np.array([[*w.outward, 0.0], w.rotation[0], [0, 0, 1]]).T for w in self._walls]
        self._frames = np.array(frames).reshape(-1, 3, 3)
        self._planes = np.array([[*w.normal, -w.offset] for w in self._walls]).reshape(-1, 4)
        ways = self._planes[:, :3] + [0.0, 0.0, 1.0]
        self._openings = ways / np.linalg.norm(ways, axis=1, keepdims=True)
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
        """(n,) m of points (n, 3) horizontally from the walls of features."""
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
            result[rows] = self._on_surfaces(T[rows], features[rows])
        return result

    def _on_surfaces(self, T: Array, features: Index) -> Mask:
        """(n,) whether what touches is measured surface."""
        corners, floor, against = self._touching(T, features)
        walls = self._wall_of[features]
        along = (corners * self._frames[walls][:, None, :, 1]).sum(axis=2)
        result = np.asarray((floor.sum(axis=1) >= 2) & against.any(axis=1))
        # Measured surface under all that touches, on the floor and on each wall.
        rows = np.flatnonzero(result)
        support = self._environment.support
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
            # In axes of the wall's foot.
            frame, tilt = self._frames[wall], float(self._tilts[wall])
            under, behind = (corners[row][on[row]] @ frame for on in (floor, against))
            lever = behind[:, 2].min() - under[:, 2].mean()
            result[row] = lever >= least_lever(self._footing) and is_held(
                under, behind, tilt, centers[row] @ frame, self._footing
            )
        return result

    def _touching(self, T: Array, features: Index) -> tuple[Array, Mask, Mask]:
        """(n, k, 3) corners in the world, (n, k) which are on the surface and which on the wall."""
        corners = self._edges.corners @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]
        planes = self._planes[self._wall_of[features]]
        low = corners[..., 2] - corners[..., 2].min(axis=1, keepdims=True)
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
            boxes = self._boxes_before(int(self._wall_of[number]), float(height))
            found[k] = self._collision.free_along(pose, self.opening(number), raised, boxes)
        return found

    def _boxes_before(self, wall: int, height: float) -> BoxArrays:
        """The obstacle set; what is of a wall, or of a surface, may be touched."""
        if (wall, height) not in self._touchable:
            behind, tops = self._behind(wall), self._environment.obstacles.tops(LEVEL)
            below = tops <= height + self._footing.contact_tolerance
            leant_on = (below | behind) & ~np.isinf(tops)
            self._touchable[wall, height] = self._collision.boxes_touching(leant_on)
        return self._touchable[wall, height]

    def opening(self, feature: int) -> Array:
        """(3,) between up and out of the wall."""
        return np.asarray(self._openings[self._wall_of[feature]])

    def moved(self, T_world_object: pin.SE3, contact: Contact, change: Array) -> pin.SE3 | None:
        """The middle of the edge moved on its surface, the object against the wall again."""
        number = np.array([contact.feature])
        point = T_world_object.act(self.references[contact.feature])[None]
        point[0, :2] += change[:2]
        tilt = self._tilts[self._wall_of[number]]
        distance = self._distances(number, point)
        if not np.isfinite(self._edges.turns(self._edge_of[number], distance, tilt)).all():
            return None
        return pin.SE3(self.poses(number, point, np.zeros(1), None)[0])

    def excluded(self, features: Index, heights: Array, low: Array, high: Array) -> Mask:
        """(n,) boxes all of which is nearer to the wall, or farther, than where the edge stays."""
        middles = np.column_stack([0.5 * (low + high)[:, :2], heights])
        walls, half = self._wall_of[features], 0.5 * (high - low)[:, :2]
        # a box reaches so much nearer than its middle, and farther
        spread = (half * np.abs(self._frames[walls][:, :2, 0])).sum(axis=1)
        away, ends = self._distances(features, middles), self._ends[features]
        return np.asarray((away + spread < ends[:, 0]) | (away - spread > ends[:, 1]))

    def resting(self, T_world_object: pin.SE3, feature: int) -> Resting:
        """On corners on the surface, and on the wall, by where that is and where it faces."""
        corners, low, near = self._touching(T_world_object.homogeneous[None], np.array([feature]))
        floor, against = corners[0][low[0]], corners[0][near[0]]
        wall = self._wall(feature)
        up, out = np.array([0.0, 0.0, 1.0]), wall.normal
        normals = [np.tile(n, (len(of), 1)) for n, of in ((up, floor), (out, against))]
        return Resting(
            "lean",
            f"the {wall}",
            np.vstack([floor, against]),
            np.vstack(normals),
            np.repeat([self._footing.friction, 0.0], [len(floor), len(against)]),
            wall.corners,
        )

    def missing(self) -> Missing | None:
        """The first that there is none of: a level surface, an edge, a wall, an edge that stays
        before it, a surface there, a wall that is high enough."""
        if self._features:
            return None
        if not self._heights:
            words = "there is no level surface in `volume` for an edge to stand on"
            return Missing(words, "volume", "choose one with a level surface")
        if not len(self._edges):
            words = f"no edge of the object's hull is {1000 * SHORTEST_M:g} mm long to stand on"
            return Missing(words, "body", "check it and `scale`")
        if not self._walls:
            words = "no wall was found in or around `volume` to lean on"
            steep = math.degrees(STEEPEST_LEAN_RAD)
            upright = f"choose one before a wall, {steep:g} degrees off upright at most"
            return Missing(words, "volume", upright)
        for wall in self._walls:
            reaches = dict.fromkeys(self._reaches.before(wall.tilt).values())
            self._strips.before(wall, reaches, too_low=True)
        return self._lacking()[max(self._reaches.lack, self._strips.lack)]

    def _lacking(self) -> dict[Lack, Missing]:
        """What is said of each."""
        footing, highest = self._footing, self._reaches.highest
        rise, touches = self._strips.lowest
        return {
            Lack.LONG_EDGE: Missing(
                "no edge of the object is long enough to lean on: it would roll, fall away from a "
                "wall, or lean so far that it slides down",
                "body",
                "check it and `scale`",
            ),
            Lack.LEVER: Missing(
                f"the object is too small to lean: it would touch a wall {highest:.3f} m above a "
                f"surface, and below {least_lever(footing):.3f} m one that is off by "
                f"contact_tolerance {footing.contact_tolerance:g} turns it too far",
                "contact_tolerance",
                "lower it, if clouds are that exact",
            ),
            Lack.FRICTION: Missing(
                f"leaning on a wall no edge stays with friction {footing.friction:g} and "
                f"stability_margin {footing.stability_margin:g}",
                "friction",
                "raise it, if surfaces are rougher, lower stability_margin, or give "
                "`center_of_mass`, if it is low",
            ),
            Lack.LENGTH: Missing(
                "edges that friction would hold are too short: the object tips over their ends "
                f"with stability_margin {footing.stability_margin:g}",
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
            Lack.WIDTH: Missing(
                "walls are narrower than what touches them",
                "volume",
                "choose one before a wider wall",
            ),
            Lack.MEASURED: Missing(
                "where an edge would stand before a wall, surface or wall ends or was not seen at "
                "the ends of what touches",
                "volume",
                "choose one before a wall that is known, or seen whole",
            ),
        }

    def _wall(self, feature: int) -> Wall:
        return self._walls[self._wall_of[feature]]
