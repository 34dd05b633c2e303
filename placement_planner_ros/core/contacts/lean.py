"""An edge of the object on a level surface, the object against a wall: the second contact class.

A feature is an edge of the hull with one side of one wall. Its reference point, the middle of the
edge, is placed on the surface before the wall, where the edge runs along the wall's foot: so the
place along the foot and the distance from it are what is free, and the distance says by how much
the object leans.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.collision.object import ObjectCollision
from placement_planner_ros.core.contacts.contact_class import Index, Mask, Missing
from placement_planner_ros.core.contacts.coplanarity import MAX_LEAN_SLOPE
from placement_planner_ros.core.contacts.friction_cones import TILT_RAD, stays
from placement_planner_ros.core.contacts.lean_edges import SHORTEST_M, LeanEdge, lean_edges
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.scene.support import SupportMap
from placement_planner_ros.core.scene.walls import Wall, find_walls
from placement_planner_ros.core.search.hierarchy import FULL_TURN, Ranges
from placement_planner_ros.core.types import LEVEL, Array, Contact, Resting, Slope

ANY_ANGLE: Ranges = ((0.0, FULL_TURN / 256),)
"""The wall says how the object is turned: one short range that is not divided."""
TOUCHING_M = 2e-4
"""m from the surface and from the wall up to which corners of the hull touch."""
STEP_M = 0.004
"""m between distances from the wall at which it is looked whether an edge could stay."""
STRIP_M = 0.01
"""m, side of the squares that strips of surface before walls are made of."""
SAME_LEVEL_M = 0.003
"""m by which heights of surfaces of one strip differ at most."""


@dataclass(frozen=True, slots=True, eq=False)
class _Feature:
    """An edge with the wall that the object leans on, m from that between which it stays, and m
    above the surface at which it touches it at least."""

    edge: LeanEdge
    wall: int
    nearest: float
    farthest: float
    touches: float


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
        self._corners = problem.body.vertices
        edges = lean_edges(problem.body.vertices)
        self._walls = find_walls(problem.environment)
        heights = _distinct_heights(problem.environment.regions)
        self._stays: dict[tuple[int, float], tuple[float, float, float] | None] = {}
        self._too_low: list[tuple[float, float]] = []  # how high a wall is, and has to be
        self._features: list[_Feature] = []
        self._regions: dict[Region, int] = {}
        for number, wall in enumerate(self._walls):
            of_wall = [
                _Feature(edge, number, *ends)
                for k, edge in enumerate(edges)
                if (ends := self._ends_of(k, edge, wall)) is not None
            ]
            strips = self._strips(wall, of_wall, heights) if of_wall else []
            high = wall.top - min((strip.z for strip in strips), default=math.inf)
            if strips and not any(feature.touches <= high for feature in of_wall):
                self._too_low.append((high, min(feature.touches for feature in of_wall)))
                strips = []
            self._regions |= dict.fromkeys(strips, number)
            self._features += of_wall if strips else []
        self.references = np.array([f.edge.reference for f in self._features]).reshape(-1, 3)
        self.frames: tuple[pin.SE3 | None, ...] = (None,) * len(self._features)
        self._edges = edges
        self._heights = heights

    @property
    def regions(self) -> tuple[Region, ...]:
        """Strips of surface before walls."""
        return tuple(self._regions)

    def ranges(self, feature: int, region: Region) -> Ranges:
        """A feature belongs before its own wall."""
        return ANY_ANGLE if self._regions[region] == self._features[feature].wall else ()

    def poses(self, features: Index, points: Array, angles: Array, slopes: Array | None) -> Array:
        """(n, 4, 4) with the middle of the edge at each point; where it cannot touch the wall from
        there, as it lies on the facet away from it."""
        T = np.tile(np.eye(4), (len(features), 1, 1))
        for number in np.unique(features):
            rows = np.flatnonzero(features == number)
            edge, wall = self._features[number].edge, self._wall(number)
            turns = edge.turns(wall.foot_distance(points[rows]), wall.tilt)
            turned = _foot_frame(wall) @ edge.rotations(np.nan_to_num(turns))
            T[rows, :3, :3] = turned
            T[rows, :3, 3] = points[rows] - turned @ edge.reference
        return T

    def stable(self, T: Array, features: Index, slope: Slope) -> Mask:
        """(n,) what touches is measured surface, and friction cones there bear the weight."""
        return np.array(
            [self._is_stable(pose, int(number)) for pose, number in zip(T, features, strict=True)],
            dtype=np.bool_,
        )

    def _is_stable(self, T: Array, number: int) -> bool:
        feature, wall = self._features[number], self._wall(number)
        foot = T[:3, :3] @ feature.edge.reference + T[:3, 3]
        distance = float(wall.foot_distance(foot[None])[0])
        if not feature.nearest <= distance <= feature.farthest:
            return False
        floor, against = self._touching(T, number)
        if len(floor) < 2 or not len(against):
            return False
        along = wall.rotation[0]
        if not self._carries(self._environment.support, floor, floor @ along):
            return False
        if not self._carries(wall.support, against @ wall.rotation.T, against @ along):
            return False
        center = T[:3, :3] @ self._body.center_of_mass + T[:3, 3]
        return self._held(floor, against, wall, center)

    def _touching(self, T: Array, number: int) -> tuple[Array, Array]:
        """(k, 3) corners on the surface, and (m, 3) on the wall, in the world."""
        wall = self._wall(number)
        corners = self._corners @ T[:3, :3].T + T[:3, 3]
        low = corners[:, 2] - corners[:, 2].min()
        near = corners @ wall.normal - wall.offset
        return corners[low <= TOUCHING_M], corners[near <= TOUCHING_M]

    def _carries(self, support: SupportMap, points: Array, along: Array) -> bool:
        """Whether surface was measured under all points, and leans no more from one to another
        along the foot than an object on it may."""
        footing = self._footing
        gaps = support.gaps(points, footing.contact_tolerance, footing.edge_margin)
        if not np.isfinite(gaps).all():
            return False
        first, last = int(np.argmin(along)), int(np.argmax(along))
        length = float(along[last] - along[first])
        off = abs(float(gaps[last] - gaps[first]))
        return bool(off <= MAX_LEAN_SLOPE * length + support.height_noise)

    def _held(self, floor: Array, against: Array, wall: Wall, center: Array) -> bool:
        """Whether friction cones at points on surface and wall bear the weight with its reserve,
        and a wall that is off by the tolerance turns the object by no more than that has."""
        along = wall.rotation[0]
        lever = float(against[:, 2].min() - floor[:, 2].mean())
        if lever * math.tan(TILT_RAD) < self._footing.contact_tolerance:
            return False
        footing = self._footing
        return stays(
            self._drawn_in(floor, along),
            self._drawn_in(against, along),
            wall.normal,
            center,
            footing.friction,
            footing.stability_margin,
        )

    def _drawn_in(self, points: Array, along: Array) -> Array:
        """(k, 3) points moved along the foot, those at the ends inwards by the tolerance, as what
        carries them may end there."""
        at = points @ along
        middle = 0.5 * (at.min() + at.max())
        half = max(0.5 * float(np.ptp(at)) - self._footing.contact_tolerance, 0.0)
        moved = np.clip(at, middle - half, middle + half)
        return np.asarray(points + (moved - at)[:, None] * along)

    def free(self, T: Array, features: Index, heights: Array, raised: float, slope: Slope) -> Mask:
        """(n,) c_f(x), on the whole way up and away from the wall; what is behind the wall's plane,
        or below the surface's, is what the object leans on."""
        found = np.zeros(len(T), np.bool_)
        tolerance = self._footing.contact_tolerance
        tops = self._environment.obstacles.tops(slope)
        barred = np.isinf(tops)
        for k, (pose, number, height) in enumerate(zip(T, features, heights, strict=True)):
            wall = self._wall(int(number))
            leant_on = (tops <= height + tolerance) | (wall.box_reach <= tolerance)
            way = self.opening(int(number))
            found[k] = self._collision.free_along(pose, way, raised, leant_on & ~barred)
        return found

    def opening(self, feature: int) -> Array:
        """(3,) between up and out of the wall."""
        way = np.array([0.0, 0.0, 1.0]) + self._wall(feature).normal
        return np.asarray(way / np.linalg.norm(way))

    def moved(self, T_world_object: pin.SE3, contact: Contact, change: Array) -> pin.SE3 | None:
        """The middle of the edge moved on its surface, the object against the wall again."""
        feature, wall = self._features[contact.feature], self._wall(contact.feature)
        point = T_world_object.act(feature.edge.reference)
        point[:2] += change[:2]
        if not np.isfinite(feature.edge.turns(wall.foot_distance(point[None]), wall.tilt)).all():
            return None
        moved = self.poses(np.array([contact.feature]), point[None], np.zeros(1), None)
        return pin.SE3(moved[0])

    def excluded(self, features: Index, heights: Array, low: Array, high: Array) -> Mask:
        """(n,) boxes all of which is nearer to the wall, or farther, than where the edge stays."""
        result = np.zeros(len(features), np.bool_)
        for row, (number, height) in enumerate(zip(features, heights, strict=True)):
            feature = self._features[int(number)]
            x, y = (low[row, 0], high[row, 0]), (low[row, 1], high[row, 1])
            corners = np.array(list(itertools.product(x, y, (height,))))
            away = self._walls[feature.wall].foot_distance(corners)
            result[row] = away.max() < feature.nearest or away.min() > feature.farthest
        return result

    def resting(self, T_world_object: pin.SE3, feature: int) -> Resting:
        """On corners on the surface, and on the wall, by where that is and where it faces."""
        floor, against = self._touching(T_world_object.homogeneous, feature)
        wall = self._wall(feature)
        up, out = np.array([0.0, 0.0, 1.0]), wall.normal
        normals = [np.tile(n, (len(of), 1)) for n, of in ((up, floor), (out, against))]
        x, y = against.mean(axis=0)[:2]
        faces = math.degrees(math.atan2(wall.outward[1], wall.outward[0]))
        on = f"the wall at ({x:.2f}, {y:.2f}) that faces {faces:.0f} degrees"
        return Resting("lean", on, np.vstack([floor, against]), np.vstack(normals))

    def missing(self) -> Missing | None:
        """The first that there is none of: a level surface, an edge, a wall, an edge that stays
        before it, a surface there, a wall that is high enough."""
        if self._features:
            return None
        footing = self._footing
        if not self._heights:
            words = "there is no level surface in target_volume for an edge to stand on"
            return Missing(words, "target_volume", "choose one with a level surface")
        if not self._edges:
            words = f"no edge of the object's hull is {1000 * SHORTEST_M:g} mm long to stand on"
            return Missing(words, "object.mesh", "check it and object.scale")
        if not self._walls:
            words = "no wall was found in or around target_volume to lean on"
            return Missing(words, "target_volume", "choose one before a wall that clouds show")
        if not any(self._stays.values()):
            words = f"leaning on a wall no edge stays with friction {footing.friction:g}"
            rough = "raise it, if surfaces are rougher; or give object.center_of_mass, if it is low"
            return Missing(words, "friction", rough)
        if self._too_low:
            has, touches = max(self._too_low, key=lambda low: low[0] - low[1])
            words = (
                f"walls are too low: the highest is {has:.3f} m above a surface before it, and the "
                f"object would touch it at {touches:.3f} m or more"
            )
            return Missing(words, "target_volume", "choose one before a higher wall")
        words = "no surface in target_volume is as near to a wall as an edge would have to stand"
        return Missing(words, "target_volume", "extend it to where floor and wall meet")

    def _wall(self, feature: int) -> Wall:
        return self._walls[self._features[feature].wall]

    def _ends_of(
        self, number: int, edge: LeanEdge, wall: Wall
    ) -> tuple[float, float, float] | None:
        """Least and greatest distance from such a wall at which the edge could stay, and the least
        height at which the object touches it then, m; the same for walls that are tilted alike."""
        key = number, round(wall.tilt, 3)
        if key not in self._stays:
            self._stays[key] = self._stays_between(edge, wall)
        return self._stays[key]

    def _stays_between(self, edge: LeanEdge, wall: Wall) -> tuple[float, float, float] | None:
        """That for a surface and a wall that are whole."""
        farthest = float(np.hypot(edge.profile[:, 0], edge.profile[:, 1]).max())
        distances = np.arange(STEP_M, farthest / math.cos(wall.tilt), STEP_M)
        turns = edge.turns(distances, wall.tilt)
        staying, heights = [], []
        aside = math.tan(TILT_RAD) + self._footing.stability_margin
        for distance, turn in zip(distances, turns, strict=True):
            if not np.isfinite(turn):
                continue
            R = _foot_frame(wall) @ edge.rotations(np.array([turn]))[0]
            corners = (self._corners - edge.reference) @ R.T
            center = R @ (self._body.center_of_mass - edge.reference)
            # The centre of mass is over the edge on the wall's side, whatever pushes it.
            if -center[:2] @ wall.outward <= aside * center[2]:
                continue
            floor = corners[corners[:, 2] <= corners[:, 2].min() + TOUCHING_M]
            near = corners @ wall.normal + distance * math.cos(wall.tilt)
            against = corners[near <= near.min() + TOUCHING_M]
            if self._held(floor, against, wall, center):
                staying.append(float(distance))
                heights.append(float(against[:, 2].min()))
        if not staying:
            return None
        return staying[0] - STEP_M, staying[-1] + STEP_M, min(heights)

    def _strips(self, wall: Wall, features: list[_Feature], heights: list[float]) -> list[Region]:
        """Strips of V before a wall, one at each height at which surface was measured there."""
        nearest = min(feature.nearest for feature in features)
        farthest = max(feature.farthest for feature in features)
        strips = []
        for height in heights:
            rectangles = self._squares_before(wall, height, (nearest, farthest))
            strip = None
            if len(rectangles):
                strip = Region(rectangles, height).within(self._environment.volume.section(height))
            if strip is not None:
                strips.append(strip)
        return strips

    def _squares_before(self, wall: Wall, height: float, ends: tuple[float, float]) -> Array:
        """(k, 4) squares whose middles are before a wall, between those distances, with surface."""
        low, high = wall.extent[:, 0]
        foot = np.array(
            [
                [
                    u * along + d * out
                    for along, out in zip(wall.rotation[0][:2], wall.outward, strict=True)
                ]
                for u, d in itertools.product((low, high), ends)
            ]
        )
        # From the origin's foot of the wall at that height.
        begin = wall.outward * (wall.offset - height * wall.normal[2]) / math.cos(wall.tilt)
        corners = foot + begin
        first = np.floor(corners.min(axis=0) / STRIP_M)
        count = np.ceil(corners.max(axis=0) / STRIP_M) - first
        i, j = np.meshgrid(*(np.arange(n) for n in count), indexing="ij")
        squares = (first + np.column_stack([i.ravel(), j.ravel()])) * STRIP_M
        middles = np.column_stack([squares + 0.5 * STRIP_M, np.full(len(squares), height)])
        away, along = wall.foot_distance(middles), middles @ wall.rotation[0]
        before = (away >= ends[0]) & (away <= ends[1]) & (along >= low) & (along <= high)
        rows = np.flatnonzero(before)
        tolerance = self._footing.contact_tolerance
        rows = rows[self._environment.support.supported(middles[rows], tolerance)]
        return np.hstack([squares[rows], squares[rows] + STRIP_M])


def _foot_frame(wall: Wall) -> Array:
    """(3, 3) columns: horizontally out of the wall, along its foot, up."""
    return np.column_stack([[*wall.outward, 0.0], wall.rotation[0], [0.0, 0.0, 1.0]])


def _distinct_heights(regions: tuple[Region, ...]) -> list[float]:
    """z of level regions, those that are about as high once, of the larger."""
    found: list[float] = []
    for region in regions:
        if region.slope == LEVEL and all(abs(region.z - z) > SAME_LEVEL_M for z in found):
            found.append(region.z)
    return found
