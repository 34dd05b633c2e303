"""Tells what of a cloud is the robot, or what it holds, by their true surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial import cKDTree
from scipy.special import ndtri

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.convex_part import polytope_of
from placement_planner_ros.core.collision.attached_object import object_solids
from placement_planner_ros.core.collision.mesh_distances import SolidSurface, rows_in_boxes
from placement_planner_ros.core.collision.meshes import mesh_arrays
from placement_planner_ros.core.collision.shapes import ConvexSet, Shape, link_shapes
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.scene.near_points import NearPoints
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import SINGLE_ROUNDING, Array, Index, Mask
from placement_planner_ros.core.weak_cache import weak_lru_cache
from placement_planner_ros.ros.inputs.point_cloud import some_of

OWN_M = 0.002
"""Off a surface, up to which a point is of that surface: joint values, grasps and meshes are no
truer."""
TAIL_PERCENT = 99.9
"""Share of a surface's own points that are no farther off than they are said to be."""
FEWEST_INSIDE = 20
"""Points inside solids from which on they tell how well is measured, or on one, how it is held; and
of those around a point that tell where the surface is."""
_COMPANY_CELLS = 1.5
"""Cells' edges between points of one thing: in the mean as far as the 26 cells around one reach."""
CROWD = 4
"""Times the fewest points of a thing; sparse clouds have fewer around a point, in the median."""


@dataclass(frozen=True, slots=True, eq=False)
class FilteredPoints:
    """How points (n, 3) lie to surfaces.

    Attributes:
        apart: (n,) metres to the nearest; infinite beyond what was looked for.
        nearest: (n, 3) where that is; NaN there.
        inside: (n,) whether they are enclosed by one.
        padded: (n,) whether they are inside, or within the padding of one.
    """

    apart: Array
    nearest: Array
    inside: Mask
    padded: Mask

    @classmethod
    def nothing(cls, n: int) -> FilteredPoints:
        """Where there are no surfaces."""
        far, none = np.full(n, np.inf), np.zeros(n, np.bool_)
        return cls(far, np.full((n, 3), np.nan), none, none.copy())

    def joined(self, other: FilteredPoints) -> FilteredPoints:
        """How they lie to the surfaces of both."""
        mine = self.apart <= other.apart
        return FilteredPoints(
            np.where(mine, self.apart, other.apart),
            np.where(mine[:, None], self.nearest, other.nearest),
            self.inside | other.inside,
            self.padded | other.padded,
        )

    def error(self) -> float:
        """Metres by which surfaces and what is measured of them err.

        Nothing but what they enclose is inside. How much points there differ from those beside them
        along the surface shows how far off it others of its own may be: how deep they are does not,
        as a shape for collisions may be larger than what cameras see.
        """
        near = self.padded & np.isfinite(self.apart)
        signed = np.where(self.inside, -self.apart, self.apart)[near]
        return float(np.hypot(OWN_M, _spread(self.nearest[near], signed)))

    def own(self, error: float) -> Mask:
        """(n,) those that are of the surfaces, no farther off than these metres, or inside.

        Farther off than the padding they are not its own.
        """
        return self.inside | (self.padded & (self.apart <= error))


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Solids and sheets where they are, with the padding of each, metres."""

    placed: tuple[tuple[pin.SE3, SolidSurface, float], ...]

    @classmethod
    def of_robot(
        cls, robot: Robot, q: Array, padding: float, of_links: Mapping[str, float] | None = None
    ) -> Outline:
        """The links at q (nq,).

        Args:
            padding: metres; `of_links` of some links instead.
        """
        paddings = [(of_links or {}).get(link, padding) for link in robot.geometry_links]
        return cls(
            tuple(
                (T, tree, own)
                for T, trees, own in zip(
                    robot.geometry_poses(q), _link_surfaces(robot), paddings, strict=True
                )
                for tree in trees
            )
        )

    @classmethod
    def of_object(cls, body: Body, T_world_object: pin.SE3, padding: float) -> Outline:
        """The object at that pose."""
        return cls(tuple((T_world_object, tree, padding) for tree in _body_surfaces(body)))

    def look(self, points: Array, least: float = 0.0) -> FilteredPoints:
        """How points (n, 3) lie to these, up to the padding of each and `least` metres."""
        found, points = FilteredPoints.nothing(len(points)), np.ascontiguousarray(points)
        for T, tree, padding in self.placed:
            cap = max(padding, least) + SINGLE_ROUNDING
            rows = rows_in_boxes(points, np.array([_upright_box(T, tree, cap)]))
            if not len(rows):
                continue
            # in the frame of the solid, whose tree stays as it is
            local = (points[rows] - T.translation) @ T.rotation
            signed, nearest = tree.distances(local, cap)
            apart, inside = np.abs(signed), signed <= 0.0
            found.inside[rows] |= inside
            found.padded[rows] |= inside | (apart <= padding + SINGLE_ROUNDING)
            # the nearest surface of all counts
            better = apart < found.apart[rows]
            found.apart[rows[better]] = apart[better]
            found.nearest[rows[better]] = nearest[better] @ T.rotation.T + T.translation
        return found

    def boxes(self) -> Array:
        """(k, 2, 3) middle and half sides of the upright box around each, with its padding."""
        found = [
            _upright_box(T, tree, padding + SINGLE_ROUNDING) for T, tree, padding in self.placed
        ]
        return np.array(found).reshape(-1, 2, 3)

    def near(self, points: Array) -> Index:
        """Rows of the points (n, 3) in the upright boxes around these."""
        return rows_in_boxes(np.ascontiguousarray(points), self.boxes())

    def outside(self, points: Array) -> Mask:
        """Which of the (n, 3) points are neither in it nor within its padding."""
        return ~self.look(points).padded


def held_outlines(
    robot: Robot, q: Array, arms: Sequence[Arm], body: Body, padding: float
) -> dict[tuple[str, int], Outline]:
    """The object in every grasp of every arm, by the arm's name and the grasp's number."""
    return {
        (arm.name, grasp): Outline.of_object(
            body, robot.link_pose(q, arm.tip_frame) * T_tip_object, padding
        )
        for arm in arms
        for grasp, T_tip_object in enumerate(arm.grasps)
    }


def outside_robot(
    points: Array, robot: Robot, q: Array, arms: Sequence[Arm], body: Body | None, padding: float
) -> Mask:
    """Which of the (n, 3) points are farther than `padding` metres from the robot at q (nq,), and
    from what it may hold, None for nothing."""
    outlines = [Outline.of_robot(robot, q, padding)]
    if body is not None:
        outlines += held_outlines(robot, q, arms, body, padding).values()
    outside = np.ones(len(points), np.bool_)
    # of each only the points are looked at that are outside of those before
    for outline in outlines:
        outside[outside] = outline.outside(points[outside])
    return outside


def near_points(
    points: Array,
    robot: Outline,
    held: Mapping[tuple[str, int], Outline],
    clear: float,
    grid: GridSettings,
    off: float = 0.0,
) -> tuple[Mask, NearPoints]:
    """What of a cloud is not the robot's, and what of the rest is an obstacle all the same.

    Left out of surfaces is what lies within the padding of the robot, or of the object in any
    grasp. Of that, what lies on none of these surfaces stays an obstacle. With the object in one
    grasp only what lies on it in that grasp is its own. As it may be nearer than the margins that
    the arm keeps, it is moved off the robot, straight, to where the arm can just leave from: by
    less than the margin, so that what keeps the margin from it there does not meet it where it is.
    What lies in the object in one grasp, outside of it in the grasp that most points lie on, and on
    none of these surfaces, is a thing that stands there: the object is not held like that.

    Args:
        points: (n, 3) metres.
        held: of the object in each grasp.
        clear: metres, the margin and what more an arm needs to leave.
        grid: fewer points than its `min_points` about a cell are errors of the sensor.
        off: metres of `clear` by which clouds may be off: where there is no room, they have none.

    Returns:
        (n,) which are farther away; and the obstacles among the others.
    """
    boxes = np.concatenate([outline.boxes() for outline in (robot, *held.values())])
    boxes[:, 1] += _COMPANY_CELLS * grid.cell_size  # what is farther away keeps company, too
    around = rows_in_boxes(np.ascontiguousarray(points), boxes)  # most points are nowhere near
    kept = np.ones(len(points), np.bool_)
    points = points[around]
    # how each point lies to the robot, and to the object in every grasp
    step("telling the robot from what is beside it")
    of_robot = robot.look(points)
    of_grasps = {}
    for grasp, outline in held.items():
        step("telling what is held from what is beside it")
        of_grasps[grasp] = outline.look(points)
    beside_held = np.zeros(len(points), np.bool_)
    for look in of_grasps.values():
        beside_held |= look.padded
    dense = _is_dense(points[of_robot.padded | beside_held], grid)

    # single points are errors of the sensor, but in a sparse cloud
    def things(others: Mask, own: Mask) -> Array:
        found = points[others]
        company = points[foreign & ~own]
        return found[_around(found, company, grid) >= grid.min_points] if dense else found

    # the object is held so that most points lie on it, if enough do to tell
    nothing = FilteredPoints.nothing(len(points))
    most = max(of_grasps.values(), key=lambda look: (look.apart <= OWN_M).sum(), default=nothing)
    error = of_robot.joined(most).error()
    # beside the robot, and not on it: an obstacle whatever is held
    foreign = ~of_robot.own(error)
    of_most = most.own(error)
    beside_robot = things(of_robot.padded & ~beside_held & foreign, of_most)
    common = _pushed(beside_robot, (robot,), clear, off)
    within = foreign & ~most.inside & ((most.apart <= OWN_M).sum() >= FEWEST_INSIDE)
    for look in of_grasps.values():
        within &= look.apart > error
    aside = {}
    # with the object in one grasp only what lies on it there is its own
    for grasp, look in of_grasps.items():
        step("telling what is held from what is beside it")
        own = look.own(error)
        others = things(beside_held & foreign & ~own, own)
        pushed = _pushed(others, (robot, held[grasp]), clear, off)
        aside[grasp] = np.vstack([pushed, things(within & look.inside, of_most)])
    kept[around] = ~(of_robot.padded | beside_held)
    return kept, NearPoints(common, aside, int((~kept).sum()))


def _is_dense(points: Array, grid: GridSettings) -> bool:
    """Whether points (n, 3) lie so close that a thing among them has several."""
    if not len(points):
        return False
    return bool(np.median(_around(some_of(points), points, grid)) >= CROWD * grid.min_points)


def _around(points: Array, others: Array, grid: GridSettings) -> Index:
    """(n,) how many of the others (m, 3) lie about a cell around each of the points (n, 3)."""
    reach = _COMPANY_CELLS * grid.cell_size
    found = cKDTree(others).query_ball_point(points, reach, return_length=True)
    return np.asarray(found)


def _pushed(given: Array, outlines: Sequence[Outline], clear: float, off: float = 0.0) -> Array:
    """(k, 3) of points (n, 3) where they are at least `clear` from all outlines, `off` less where
    surfaces are too near to each other for that; without those between still nearer ones."""
    points = given.copy()
    for _ in range(4):  # off one surface after the other
        # how they lie to the nearest surface of all outlines
        look = outlines[0].look(points, clear)
        for outline in outlines[1:]:
            look = look.joined(outline.look(points, clear))
        rows = np.flatnonzero((look.apart < clear) | look.inside)
        if not len(rows):
            break
        # straight off the nearest surface; what is inside one goes through it
        away = points[rows] - look.nearest[rows]
        away[look.inside[rows]] *= -1.0
        length = np.maximum(look.apart[rows], SINGLE_ROUNDING)[:, None]
        points[rows] = look.nearest[rows] + away / length * (clear + SINGLE_ROUNDING)
    # what was still too near at the last look is between surfaces
    kept: Mask = np.asarray(np.isfinite(points).all(axis=1))
    kept[rows] = False
    nearer = _pushed(given[rows], outlines, clear - off) if off and len(rows) else points[:0]
    return np.vstack([points[kept], nearer])


def _spread(nearest: Array, signed: Array) -> float:
    """Metres by which points of surfaces differ from those around them, but for their tail; 0 where
    too few are inside to tell.

    Args:
        nearest: (n, 3) where a surface is nearest to each.
        signed: (n,) how far outside of it they are, negative inside.
    """
    inside = some_of(np.column_stack([nearest, signed])[signed < 0.0])
    if len(inside) < FEWEST_INSIDE:
        return 0.0
    # along the surface, so that neighbours of a point do not err as it does
    _, around = cKDTree(nearest).query(inside[:, :3], FEWEST_INSIDE)
    off = inside[:, 3] - signed[around[:, 1:]].mean(axis=1)  # the first is the point itself
    # half of the errors lie within a quartile; what rises or falls steeply is little of a surface
    deviation = np.median(np.abs(off)) / ndtri(0.75)
    return float(ndtri(0.5 + TAIL_PERCENT / 200.0) * deviation)


def _upright_box(T: pin.SE3, tree: SolidSurface, cap: float) -> tuple[Array, Array]:
    """Middle and half sides (3,) of the box around a solid at T, grown by `cap` metres."""
    low, high = tree.box
    # the extent of a turned box along each axis
    return T.act((low + high) / 2), np.abs(T.rotation) @ ((high - low) / 2) + cap


@weak_lru_cache("robot", maxsize=1)
def _link_surfaces(robot: Robot) -> tuple[tuple[SolidSurface, ...], ...]:
    """Of each of the robot's geometries, in its own frame."""
    return tuple(map(_surfaces_of, link_shapes(robot)))


@weak_lru_cache("body", maxsize=1)
def _body_surfaces(body: Body) -> tuple[SolidSurface, ...]:
    """Of the object's convex pieces, and of all others together."""
    return tuple(each for solid in object_solids(body) for each in _surfaces_of(solid.shape))


def _surfaces_of(shape: Shape) -> tuple[SolidSurface, ...]:
    step("making the surfaces of the robot and of the object")
    if shape.mesh is not None:
        return (SolidSurface(mesh_arrays([shape.mesh])),)
    return tuple(map(_convex_surface, shape.sets))


def _convex_surface(shape: ConvexSet) -> SolidSurface:
    """A polytope, or a point or a line, and what is within its radius."""
    if len(shape.normals):
        return SolidSurface.of(polytope_of(shape.vertices).corners, shape.radius)
    # a point or a line is a triangle without area
    return SolidSurface.of(shape.vertices[[0, -1, -1]][None], shape.radius)
