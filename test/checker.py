"""The independent checker: is a published solution right, judged by the scene's true solids?

It shares no code with the planner's own checks. Robot, scene and object are rebuilt from the URDF
text and from meshes; the motion is the quintic a joint_trajectory_controller plays.

The margin is owed to what was measured, given as boxes: it is checked to the 0.02 mm. True solids
stand out beyond that by up to 3 mm, as much as the margin: the bundled scenes' complete clouds, of
a point every 5 mm, leave 2.3 mm of them outside of the boxes in 99 % of all places, 2.7 mm to
3.3 mm in 99.9 %, and more only in the corner between two walls. So they are checked for
penetration.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, cKDTree

Array = npt.NDArray[np.float64]

_CONTACTS = 1000
"""Contacts of a mesh that are looked at for its depth."""
_DEEP = 1.0
"""m, the depth of what lies wholly inside of a mesh."""

WORLD = "environment"
"""Link name of everything that does not move."""


class Solid(Protocol):
    """A convex solid: the hull of its vertices (n, 3), world frame."""

    @property
    def name(self) -> str: ...
    @property
    def vertices(self) -> Array: ...


class Curve(Protocol):
    """A trajectory: times (n,), positions, velocities, accelerations (n, len(joints))."""

    joints: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array
    accelerations: Array


@dataclass(frozen=True)
class Task:
    """What was asked.

    Attributes:
        solids: the environment's true convex solids.
        volume_lower, volume_upper: (3,) corners of V, or (k, 3) of the boxes whose union it is.
        object_vertices, object_triangles, center_of_mass: the object in its own frame: each of its
            connected components the solid that its triangles close, or a sheet.
        urdf, srdf: texts; `package://<name>/` leads to package_dirs[name].
        q_start: joint name -> value of every joint that mimics no other.
        objective: `maximize_clearance`, `minimize_clearance`, or anything else for "do not check".
        measured: (2, n, 3) lower and upper corners of the boxes that hold what was measured; None
            for "do not check the margin".
        beyond: how far outside V things count for the clearance, metres.
    """

    solids: Sequence[Solid]
    volume_lower: Array
    volume_upper: Array
    object_vertices: Array
    object_triangles: npt.NDArray[np.int64]
    center_of_mass: Array
    urdf: str
    srdf: str
    package_dirs: Mapping[str, str | Path]
    q_start: Mapping[str, float]
    objective: str
    measured: Array | None = None
    beyond: float = 0.0

    @property
    def volume(self) -> Array:
        """(k, 2, 3) corners of V's boxes."""
        corners = np.atleast_2d(self.volume_lower), np.atleast_2d(self.volume_upper)
        return np.stack(corners, axis=1)

    @classmethod
    def of(
        cls,
        scene: Any,
        thing: Any,
        urdf: str,
        srdf: str,
        package_dirs: Mapping[str, str | Path],
        q_start: Mapping[str, float],
        objective: str,
    ) -> Task:
        """Of a bundled `Scene` and `GraspedObject`."""
        return cls(
            scene.parts,
            scene.volume.boxes[:, 0],
            scene.volume.boxes[:, 1],
            thing.vertices,
            thing.triangles,
            thing.center_of_mass,
            urdf,
            srdf,
            package_dirs,
            q_start,
            objective,
        )


@dataclass(frozen=True)
class Solution:
    """What was published, with the grasp it refers to."""

    trajectory: Curve
    approach_start: float
    placement_pose: Array  # (4, 4) T_world_object
    objective: float
    tip_frame: str
    T_tip_object: Array  # (4, 4)
    touch_links: Sequence[str]
    retreat: Curve | None = None
    gripper_open: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, placement: Any, arm: Any) -> Solution:
        """Of a `Placement` and the `Arm` it was found for."""
        return cls(
            placement.trajectory,
            placement.approach_start,
            placement.T_world_object.homogeneous,
            placement.objective,
            arm.tip_frame,
            arm.grasps[placement.goal.grasp].homogeneous,
            arm.touch_links,
            placement.retreat,
            dict(zip(arm.gripper_joints, arm.gripper_open, strict=True)),
        )


@dataclass(frozen=True)
class Tolerances:
    """Metres, radians, seconds.

    Attributes:
        margin: to be kept from what was measured.
        contact: the contact tolerance of the planner.
        step: no point of the robot moves further than this between two checked states.
        acceleration_limit: per joint of the trajectory, or one for all.
        limit: relative excess over a limit that is forgiven.
        penetration: numerical slack of the collision library.
        flatness: vertices this close to the lowest, along the normal of the surface, are those it
            stands on.
        slope: rad, what is steeper carries nothing.
        lean: rad that the object may be turned from the normal of the surface it stands on.
        objective: between the published ξ and those recomputed from the true solids.
        layer: height of the planner's cells, which ξ may be coarse by (`clearance_bounds`).
        improvement: by which ξ must exceed the previous one.
        pushing: how much deeper a finger may get into the object while it opens.
        touching: way of the hand, at the longest, on which links that touch the object when the
            hand is open may touch it still; those that have come off before must not meet it again.
        parted: distance of all links from the object at the end of the retreat, at least.
    """

    margin: float = 0.003
    contact: float = 0.003
    step: float = 0.002
    acceleration_limit: float | Mapping[str, float] = np.inf
    velocity_scaling: float = 1.0
    limit: float = 1e-3
    penetration: float = 2e-5
    flatness: float = 1e-3
    slope: float = 0.27
    lean: float = 0.008
    height: float = 5e-4
    edge: float = 1e-5
    position: float = 5e-4
    angle: float = np.deg2rad(0.2)
    objective: float = 0.01
    layer: float = 0.01
    improvement: float = 0.0
    pushing: float = 2e-4
    touching: float = 3.05e-3
    parted: float = 1e-3


def check_solution(
    task: Task,
    solution: Solution,
    previous_objective: float | None = None,
    tolerances: Tolerances | None = None,
) -> list[str]:
    """Everything that is wrong with a solution, one sentence each; empty where it is right."""
    return SolutionChecker(task, tolerances).check(solution, previous_objective)


class SolutionChecker:
    """Checks any number of solutions to one task."""

    def __init__(self, task: Task, tolerances: Tolerances | None = None) -> None:
        self.task = task
        self.tolerances = Tolerances() if tolerances is None else tolerances
        self.robot = RobotModel.read(task.urdf, task.srdf, task.package_dirs)
        self.components = object_pieces(task.object_vertices, task.object_triangles)
        self._samples = piece_voxels(self.components)

    def check(self, solution: Solution, previous_objective: float | None = None) -> list[str]:
        """Violations of one solution."""
        shape = self._check_shape(solution)
        if shape:
            return shape
        states, times = self._states(solution.trajectory, self._q_start())
        return [
            *self._check_start(solution),
            *self._check_limits(solution.trajectory),
            *self._check_end(solution, states[-1]),
            *self._check_collisions(solution, states, times),
            *check_stance(self.task, np.asarray(solution.placement_pose), self.tolerances),
            *self._check_objective(solution, previous_objective),
            *self._check_leaving(solution, states[-1]),
        ]

    def clearance(self, T_world_object: Array) -> float:
        """C: mean distance of the object's voxel centres sideways and upwards, metres."""
        return float(self._distances(T_world_object, 0.0).mean())

    def clearance_bounds(self, T_world_object: Array) -> tuple[float, float]:
        """Least and greatest C where heights are known to a layer of cells only.

        What ends within a layer above a point may count as beside or as below it: distances
        sideways and upwards jump there, whatever the cells' size.
        """
        exact = self._distances(T_world_object, 0.0)
        raised = self._distances(T_world_object, self.tolerances.layer)
        return float(np.minimum(exact, raised).mean()), float(np.maximum(exact, raised).mean())

    def _distances(self, T_world_object: Array, raised: float) -> Array:
        """Sideways is along the surface that the object stands on: heights are those above a plane
        of its slope, of V through its middle."""
        normal = surface_normal(self.task, T_world_object, self.tolerances)
        shear = np.eye(3)
        shear[2, :2] = normal[:2] / normal[2]
        points = (self._samples @ T_world_object[:3, :3].T + T_world_object[:3, 3]) @ shear.T
        points[:, 2] += raised
        lowest = (_world_vertices(self.task, T_world_object) @ shear.T)[:, 2].min()
        best = np.full(len(points), 0.5)
        volume = np.array(self.task.volume)
        middle = 0.5 * (volume[:, 0].min(axis=0) + volume[:, 1].max(axis=0))
        volume[:, :, 2] += float(shear[2, :2] @ middle[:2])
        for solid in self.task.solids:
            vertices = np.asarray(solid.vertices) @ shear.T
            if vertices[:, 2].max() <= lowest + self.tolerances.contact:
                continue
            for outline, low, high in upright_prisms(vertices):
                for lower, upper in volume:
                    ends = lower - self.task.beyond, upper + self.task.beyond
                    _lower_distance(best, points, outline, low, high, *ends)
        return best

    def _check_shape(self, solution: Solution) -> list[str]:
        found = self._check_curve(solution.trajectory, "trajectory")
        if not found and not 0 <= solution.approach_start <= solution.trajectory.times[-1]:
            found.append("approach_start: outside the trajectory")
        if solution.retreat is not None:
            found += self._check_curve(solution.retreat, "retreat")
        return found

    def _check_curve(self, curve: Curve, name: str) -> list[str]:
        found = []
        times = np.asarray(curve.times)
        values = [curve.positions, curve.velocities, curve.accelerations]
        if any(np.shape(v) != (len(times), len(curve.joints)) for v in values):
            return [f"{name}: positions, velocities, accelerations differ in shape"]
        if len(times) < 2:
            return [f"{name}: fewer than two points"]
        if not all(np.isfinite(v).all() for v in [times, *values]):
            return [f"{name}: not finite"]
        unknown = [joint for joint in curve.joints if joint not in self.robot.index]
        if unknown:
            return [f"{name}: unknown joints {unknown}"]
        if not (np.diff(times) > 0).all():
            found.append(f"{name}: times do not increase strictly")
        if times[0] < 0:
            found.append(f"{name}: begins before 0")
        return found

    def _check_start(self, solution: Solution) -> list[str]:
        curve = solution.trajectory
        q0 = np.array([self.task.q_start[name] for name in curve.joints])
        error = np.abs(curve.positions[0] - q0).max()
        found = [f"start: {error:.2g} from q_0"] if error > 1e-6 else []
        if np.abs(curve.velocities[0]).max() > 1e-6:
            found.append("start: moving")
        return found

    def _q_start(self) -> Array:
        return self.robot.configuration(self.task.q_start)

    def _states(self, curve: Curve, q_rest: Array) -> tuple[Array, Array]:
        """(k, nq) states along the curve, no point moving more than `step` between two; times.

        Joints that are not the curve's stand as in q_rest (nq,).
        """
        columns = [self.robot.index[name] for name in curve.joints]
        reach = self.robot.reach(self.task.object_vertices)[columns]
        rows, times = [], []
        for segment, duration in enumerate(np.diff(curve.times)):
            coarse = _quintic(curve, segment, np.linspace(0, duration, 41))[0]
            travelled = np.concatenate([[0], np.cumsum(np.abs(np.diff(coarse, axis=0)) @ reach)])
            count = max(int(np.ceil(1.05 * travelled[-1] / self.tolerances.step)), 1)
            wanted = np.arange(count) / count * travelled[-1]
            rising = travelled + np.linspace(0, 1e-12, len(travelled))
            t = np.interp(wanted, rising, np.linspace(0, duration, 41))
            rows.append(_quintic(curve, segment, t)[0])
            times.append(curve.times[segment] + t)
        moving = np.vstack([*rows, curve.positions[-1:]])
        states = np.tile(q_rest, (len(moving), 1))
        states[:, columns] = moving
        self.robot.fill_mimics(states)
        return states, np.concatenate([*times, curve.times[-1:]])

    def _check_limits(self, curve: Curve) -> list[str]:
        found = []
        columns = [self.robot.index[name] for name in curve.joints]
        lower, upper = self.robot.model.lowerPositionLimit, self.robot.model.upperPositionLimit
        speed = self.robot.model.velocityLimit[columns] * self.tolerances.velocity_scaling
        limit = self.tolerances.acceleration_limit
        strength = np.array(
            [limit[n] if isinstance(limit, Mapping) else limit for n in curve.joints]
        )
        parts = [
            _quintic(curve, i, np.linspace(0, duration, 33))
            for i, duration in enumerate(np.diff(curve.times))
        ]
        q, v, a = (np.vstack([part[k] for part in parts]) for k in range(3))
        slack = self.tolerances.limit
        for k, (name, column) in enumerate(zip(curve.joints, columns, strict=True)):
            margin = 1e-6 + slack * 1e-2
            if q[:, k].min() < lower[column] - margin or q[:, k].max() > upper[column] + margin:
                found.append(f"limits: {name} leaves its range")
            top = np.abs(v[:, k]).max()
            if top > speed[k] * (1 + slack) + 1e-6:
                found.append(f"limits: {name} turns at {top:.4g}, allowed {speed[k]:.4g}")
            top = np.abs(a[:, k]).max()
            if top > strength[k] * (1 + slack) + 1e-6:
                found.append(f"limits: {name} accelerates at {top:.4g}, allowed {strength[k]:.4g}")
        return found

    def _check_end(self, solution: Solution, q_end: Array) -> list[str]:
        found = []
        if np.abs(solution.trajectory.velocities[-1]).max() > 1e-6:
            found.append("end: not at rest")
        T = self.robot.frame_pose(q_end, solution.tip_frame) @ solution.T_tip_object
        published = np.asarray(solution.placement_pose)
        offset = float(np.linalg.norm(T[:3, 3] - published[:3, 3]))
        angle = float(np.linalg.norm(pin.log3(T[:3, :3].T @ published[:3, :3])))
        if offset > self.tolerances.position:
            found.append(f"end: object {1000 * offset:.2f} mm from the published pose")
        if angle > self.tolerances.angle:
            found.append(f"end: object turned by {np.rad2deg(angle):.2f}° from the published pose")
        return found

    def _check_collisions(self, solution: Solution, states: Array, times: Array) -> list[str]:
        pose = np.asarray(solution.placement_pose)
        normal = surface_normal(self.task, pose, self.tolerances)
        lowest = float((_world_vertices(self.task, pose) @ normal).min())
        support = {
            solid.name
            for solid in self.task.solids
            if abs(float((solid.vertices @ normal).max()) - lowest)
            <= self.tolerances.contact + 1e-9
        }
        world = World.build(
            self.robot, self.task, self.components, solution, self.tolerances.contact
        )
        return world.sweep(states, times, solution.approach_start, support, self.tolerances)

    def _check_leaving(self, solution: Solution, q_end: Array) -> list[str]:
        """Release and retreat: the object stands at the published pose, the hand opens and goes.

        A touch link that opening has brought off the object must not meet it again; the others must
        come off on the first `touching` metres, and not meet it again after that.
        """
        curve = solution.retreat
        if curve is None:
            return []
        found = []
        end = solution.trajectory
        same = [end.joints.index(joint) for joint in curve.joints if joint in end.joints]
        if len(same) < len(curve.joints) or set(curve.joints) != set(end.joints):
            return ["retreat: other joints than the trajectory's"]
        if not np.array_equal(curve.positions[0], np.asarray(end.positions[-1])[same]):
            found.append("retreat: does not begin where the trajectory ends")
        if max(np.abs(curve.velocities[i]).max() for i in (0, -1)) > 1e-6:
            found.append("retreat: not from rest to rest")
        found += [f"retreat: {violation}" for violation in self._check_limits(curve)]

        q_open = q_end[None].copy()
        for joint, value in solution.gripper_open.items():
            q_open[0, self.robot.index[joint]] = value
        self.robot.fill_mimics(q_open)
        travelled = np.abs(q_open[0] - q_end) @ self.robot.reach(self.task.object_vertices)
        count = 2 + int(2 * travelled / self.tolerances.step)
        opening = q_end + np.linspace(0, 1, count)[:, None] * (q_open - q_end)
        contact = self.tolerances.contact
        whole = World.build(self.robot, self.task, self.components, solution, contact, placed=())
        gaps = whole.object_gaps(opening, solution.touch_links)
        for link, gap in gaps.items():
            deeper = min(gap[0], 0.0) - gap.min()
            if deeper > self.tolerances.pushing:
                found.append(f"release: {link} gets {1000 * deeper:.2f} mm further into the object")
        world = World.build(
            self.robot, self.task, self.components, solution, contact, placed=solution.touch_links
        )
        for violation in world.sweep(opening, np.zeros(count), np.inf, set(), self.tolerances):
            found.append(f"release: {violation}")
        slides = [link for link, gap in gaps.items() if gap[-1] <= self.tolerances.parted]
        states, times = self._states(curve, q_open[0])
        off = self._off(whole, solution, states, slides)
        ends = sorted({0, len(states), *off.values()})
        said = set()
        for begin, end in pairwise(ends):
            touch = [link for link in slides if off[link] > begin]
            world = World.build(
                self.robot, self.task, self.components, solution, contact, placed=touch
            )
            stretch = slice(begin, end)
            for violation in world.sweep(
                states[stretch], times[stretch], np.inf, set(), self.tolerances
            ):
                who = violation.split(" at ")[0]
                if who not in said:
                    said.add(who)
                    found.append(f"retreat: {violation}")
        before = self._q_start()[None]
        for link, (start, end) in whole.object_gaps(np.vstack([before, states[-1:]])).items():
            if end < self.tolerances.parted and start != end:  # what the arm does not move stays
                found.append(f"retreat: ends with {link} {1000 * end:.2f} mm from the object")
        return found

    def _off(
        self, whole: World, solution: Solution, states: Array, slides: Sequence[str]
    ) -> dict[str, int]:
        """Of links that touch the object at first the row of the state from which on none may."""
        if not slides:
            return {}
        tips = np.array([self.robot.frame_pose(q, solution.tip_frame)[:3, 3] for q in states])
        gone = np.linalg.norm(tips - tips[0], axis=1) > self.tolerances.touching
        last = int(np.argmax(gone)) if gone.any() else len(states)
        gaps = whole.object_gaps(states[:last], slides)
        off = {}
        for link in slides:
            parted = gaps[link] > self.tolerances.parted
            off[link] = int(np.argmax(parted)) if parted.any() else last
        return off

    def _check_objective(self, solution: Solution, previous: float | None) -> list[str]:
        found = []
        sign = {"maximize_clearance": 1.0, "minimize_clearance": -1.0}.get(self.task.objective)
        if sign is not None:
            bounds = self.clearance_bounds(np.asarray(solution.placement_pose))
            own, slack = sign * solution.objective, self.tolerances.objective
            if not bounds[0] - slack <= own <= bounds[1] + slack:
                low, high = sorted(sign * bound for bound in bounds)
                found.append(
                    f"objective: published {solution.objective:.4f}, is {low:.4f} to {high:.4f}"
                )
        if previous is not None and solution.objective <= previous + self.tolerances.improvement:
            found.append(f"objective: {solution.objective:.6g} after {previous:.6g}")
        return found


def _world_vertices(task: Task, T_world_object: Array) -> Array:
    vertices = np.asarray(task.object_vertices)
    return np.asarray(vertices @ T_world_object[:3, :3].T + T_world_object[:3, 3])


def surface_normal(task: Task, T_world_object: Array, tolerances: Tolerances) -> Array:
    """(3,) up, along the normal of what an object at a pose (4, 4) stands on; z where that is
    level, and where it stands on nothing.

    Of the normals of all facets that face up and are not too steep, that along which the object's
    feet are nearest to such facets.
    """
    vertices, level = _world_vertices(task, T_world_object), np.array([0.0, 0.0, 1.0])
    normals = [level]
    for solid in task.solids:
        for normal, _ in upward_facets(solid.vertices, tolerances.slope):
            if min(np.abs(normal - each).max() for each in normals) > 1e-6:
                normals.append(normal)
    best, least = level, np.inf
    for normal in normals:
        feet = _feet(vertices, normal, tolerances)
        if len(feet) < 3 or np.linalg.matrix_rank(feet[1:] - feet[0], tol=1e-4) < 2:
            continue
        gap = max(_gap(task.solids, foot, normal, tolerances) for foot in feet)
        if gap < least - 1e-4:
            best, least = normal, gap
    return best


def upward_facets(vertices: Array, steepest: float) -> list[tuple[Array, Array]]:
    """Unit normal (3,) and corners (k, 3) of the facets of a convex solid that face up, none
    steeper than that, rad."""
    vertices = np.asarray(vertices)
    found = []
    planes = np.unique(np.round(ConvexHull(vertices).equations, 7), axis=0)
    for plane in planes[planes[:, 2] >= np.cos(steepest)]:
        corners = vertices[np.abs(vertices @ plane[:3] + plane[3]) <= 1e-6]
        found.append((plane[:3] / np.linalg.norm(plane[:3]), corners))
    return found


def _feet(vertices: Array, normal: Array, tolerances: Tolerances) -> Array:
    """(k, 3) the vertices that are lowest along a normal."""
    heights = vertices @ normal
    return np.unique(vertices[heights <= heights.min() + tolerances.flatness], axis=0)


def check_stance(task: Task, T_world_object: Array, tolerances: Tolerances) -> list[str]:
    """What is wrong with an object left at a pose (4, 4): standing on its face, within V.

    On a slope it stands along the surface's normal, and its centre of mass is above its face along
    gravity.
    """
    T, found = T_world_object, []
    normal = surface_normal(task, T, tolerances)
    feet = _feet(_world_vertices(task, T), normal, tolerances)
    com = T[:3, :3] @ task.center_of_mass + T[:3, 3]
    if len(feet) < 3 or np.linalg.matrix_rank(feet[1:, :2] - feet[0, :2], tol=1e-4) < 2:
        found.append("stance: stands on an edge or a corner")
    else:
        hull = ConvexHull(feet[:, :2])
        if (hull.equations[:, :2] @ com[:2] + hull.equations[:, 2]).max() > 0:
            found.append("stance: centre of mass beyond the face it stands on")
        across = np.linalg.svd(feet - feet.mean(axis=0))[2][-1]
        lean = float(np.arccos(min(abs(float(across @ normal)), 1.0)))
        if lean > tolerances.lean:
            found.append(f"stance: leans by {np.rad2deg(lean):.2f}° on what it stands on")
    gaps = np.array([_gap(task.solids, foot, normal, tolerances) for foot in feet])
    if gaps.max() > tolerances.contact + tolerances.height:
        where = feet[np.argmax(gaps)].round(4).tolist()
        found.append(f"stance: nothing under the vertex at {where}")
    slack = np.array([1e-6, 1e-6, tolerances.contact])
    lower, upper = task.volume[:, 0] - slack, task.volume[:, 1] + slack
    ends = feet[:, 2].min(), feet[:, 2].max()  # on a slope some foot is the contact point
    at_height = (lower[:, 2] <= ends[1]) & (ends[0] <= upper[:, 2])
    touched = (feet[:, None] >= lower) & (feet[:, None] <= upper)
    if not touched.all(axis=2).any():
        found.append("volume: no contact point in V")
    over = ((com >= lower) & (com <= upper))[:, :2].all(axis=1)
    if not (over & at_height if at_height.any() else over).any():
        found.append("volume: centre of mass not over V")
    return found


def _gap(solids: Sequence[Solid], point: Array, normal: Array, tolerances: Tolerances) -> float:
    """Vertical distance between a point and the surface nearest in height that has that normal."""
    best = np.inf
    for solid in solids:
        for facet, corners in upward_facets(solid.vertices, tolerances.slope):
            if np.arccos(min(float(facet @ normal), 1.0)) > tolerances.lean:
                continue
            gap = abs(float((point - corners[0]) @ facet)) / float(facet[2])
            if len(corners) >= 3 and gap < best:
                hull = ConvexHull(corners[:, :2])
                if (hull.equations[:, :2] @ point[:2] + hull.equations[:, 2]).max() <= (
                    tolerances.edge
                ):
                    best = gap
    return best


@dataclass(frozen=True)
class RobotModel:
    """The robot rebuilt from its URDF text."""

    model: pin.Model
    geometry: pin.GeometryModel
    index: dict[str, int]
    mimics: dict[str, tuple[str, float, float]]
    disabled: frozenset[frozenset[str]]
    pieces: Mapping[int, Sequence[tuple[Array, bool]]]
    """Of each geometry that is a mesh and not convex its connected components: (t, 3, 3) corners of
    triangles, and whether they close a solid; open ones are sheets."""

    @classmethod
    def read(cls, urdf: str, srdf: str, package_dirs: Mapping[str, str | Path]) -> RobotModel:
        root = ElementTree.fromstring(urdf)
        mimics = {}
        for joint in root.iter("joint"):
            name = str(joint.get("name"))
            if joint.get("type") == "continuous":  # one coordinate, as everywhere
                joint.set("type", "revolute")
                limit = joint.find("limit")
                limit = ElementTree.SubElement(joint, "limit") if limit is None else limit
                for key, value in {"lower": "-1e9", "upper": "1e9"}.items():
                    limit.set(key, value)
                for key in ("velocity", "effort"):
                    limit.set(key, limit.get(key) or "1e9")
            mimic = joint.find("mimic")
            if mimic is not None:
                factor = float(mimic.get("multiplier", "1"))
                mimics[name] = (str(mimic.get("joint")), factor, float(mimic.get("offset", "0")))
        for mesh in root.iter("mesh"):
            file = str(mesh.get("filename"))
            for package, folder in package_dirs.items():
                file = file.replace(f"package://{package}/", f"{folder}/")
            mesh.set("filename", file)
        text = ElementTree.tostring(root, encoding="unicode")
        model = pin.buildModelFromXML(text)
        geometry = pin.buildGeomFromUrdfString(model, text, pin.COLLISION)
        for thing in geometry.geometryObjects:
            thing.geometry = _as_convex(thing.geometry)
        pairs = ElementTree.fromstring(srdf).iter("disable_collisions") if srdf else ()
        disabled = frozenset(frozenset({str(p.get("link1")), str(p.get("link2"))}) for p in pairs)
        index = {name: int(model.joints[i + 1].idx_q) for i, name in enumerate(model.names[1:])}
        pieces = {
            i: mesh_components(*_mesh(thing.geometry))
            for i, thing in enumerate(geometry.geometryObjects)
            if isinstance(thing.geometry, coal.BVHModelBase)
        }
        return cls(model, geometry, index, mimics, disabled, pieces)

    def fill_mimics(self, states: Array) -> None:
        for name, (master, factor, offset) in self.mimics.items():
            states[:, self.index[name]] = factor * states[:, self.index[master]] + offset

    def configuration(self, positions: Mapping[str, float]) -> Array:
        q = np.zeros((1, self.model.nq))
        for name, column in self.index.items():
            if name not in self.mimics:
                q[0, column] = positions[name]
        self.fill_mimics(q)
        return np.asarray(q[0])

    def frame_pose(self, q: Array, frame: str) -> Array:
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, q)
        return np.array(data.oMf[self.model.getFrameId(frame)].homogeneous)

    def reach(self, object_vertices: Array) -> Array:
        """(nq,) most metres any point (the held object's included) moves per unit of a joint."""
        held = 2 * float(np.linalg.norm(object_vertices, axis=1).max()) + 0.2
        extent = np.full(self.model.njoints, held)
        for thing in self.geometry.geometryObjects:
            shape = thing.geometry
            shape.computeLocalAABB()
            centre = thing.placement.act(np.asarray(shape.aabb_center))
            size = float(np.linalg.norm(centre)) + float(shape.aabb_radius)
            extent[thing.parentJoint] = max(extent[thing.parentJoint], size)
        result = np.ones(self.model.nq)
        for joint in range(self.model.njoints - 1, 0, -1):
            parent = self.model.parents[joint]
            sliding = self.model.joints[joint].shortname().startswith("JointModelP")
            column = self.model.joints[joint].idx_q
            far = extent[joint]
            if sliding:
                far += abs(self.model.upperPositionLimit[column])
            else:
                result[column] = extent[joint]
            offset = float(np.linalg.norm(self.model.jointPlacements[joint].translation))
            extent[parent] = max(extent[parent], offset + far)
        return result


@dataclass(frozen=True)
class World:
    """Robot, held object and environment as one pinocchio geometry model."""

    robot: RobotModel
    geometry: pin.GeometryModel
    links: list[str] = field(default_factory=list)
    moving: list[int] = field(default_factory=list)
    """Geometries that the arm moves."""
    pieces: Mapping[int, Sequence[tuple[Array, bool]]] = field(default_factory=dict)
    """`RobotModel.pieces`, and those of the object's pieces that are not convex."""
    measured: Array | None = None
    support: npt.NDArray[np.bool_] | None = None
    """(n,) which of the measured boxes are."""

    @classmethod
    def build(
        cls,
        robot: RobotModel,
        task: Task,
        components: Sequence[Piece],
        solution: Solution,
        contact: float,
        placed: Sequence[str] | None = None,
    ) -> World:
        """With the object in the hand, or at the published pose with `placed` free to touch it.

        Args:
            contact: what was measured with its top so close to the contact plane is support.
        """
        geometry = pin.GeometryModel(robot.geometry)
        geometry.removeAllCollisionPairs()
        links = [str(robot.model.frames[g.parentFrame].name) for g in geometry.geometryObjects]
        tip = robot.model.frames[robot.model.getFrameId(solution.tip_frame)]
        joint, T_joint_object = tip.parentJoint, tip.placement * pin.SE3(solution.T_tip_object)
        touching_links = set(solution.touch_links)
        if placed is not None:
            joint, T_joint_object = 0, pin.SE3(np.asarray(solution.placement_pose))
            touching_links = set(placed)
        pieces = dict(robot.pieces)
        for i, piece in enumerate(components):
            if not piece.solid:
                pieces[len(links)] = [(piece.corners, piece.closed)]
            geometry.addGeometryObject(
                pin.GeometryObject(f"object/{i}", joint, T_joint_object, piece.shape)
            )
            links.append("object")
        for i, solid in enumerate(task.solids):
            geometry.addGeometryObject(
                pin.GeometryObject(
                    f"{WORLD}/{i}/{solid.name}",
                    0,
                    pin.SE3.Identity(),
                    convex(np.asarray(solid.vertices)),
                )
            )
            links.append(WORLD)
        for i in range(len(links)):
            for j in range(i):
                pair = frozenset({links[i], links[j]})
                fixed = all(
                    geometry.geometryObjects[k].parentJoint == 0 for k in (i, j)
                )  # the base stands on what it stands on
                touching = "object" in pair and bool(pair & touching_links)
                if len(pair) == 2 and not (fixed or touching or pair in robot.disabled):
                    geometry.addCollisionPair(pin.CollisionPair(j, i))
        for thing in geometry.geometryObjects:
            thing.geometry.computeLocalAABB()
        ids = {robot.model.getJointId(joint) for joint in solution.trajectory.joints}
        moving = [
            i
            for i, thing in enumerate(geometry.geometryObjects)
            if ids & set(robot.model.supports[thing.parentJoint].tolist())
        ]
        measured = support = None
        if task.measured is not None:
            measured = np.asarray(task.measured)
            pose = np.asarray(solution.placement_pose)
            normal = surface_normal(task, pose, Tolerances(contact=contact))
            lowest = (_world_vertices(task, pose) @ normal).min() / normal[2]
            # the plane that it stands on is between these heights within a box
            rises = lowest / 2 - measured[:, :, :2] * (normal[:2] / normal[2])
            low, high = rises.min(axis=0).sum(axis=1), rises.max(axis=0).sum(axis=1)
            top = measured[1, :, 2]
            support = (top >= low - contact - 1e-4) & (top <= high + contact + 1e-4)
        return cls(robot, geometry, links, moving, pieces, measured, support)

    def object_gaps(self, states: Array, only: Sequence[str] | None = None) -> dict[str, Array]:
        """Link -> its signed distance from the object at each of the states (k, nq)."""
        model, geometry = self.robot.model, self.geometry
        data, shapes = model.createData(), geometry.createData()
        for request in shapes.distanceRequests:
            request.enable_signed_distance = True
        gaps: dict[str, Array] = {}
        for row, state in enumerate(states):
            pin.updateGeometryPlacements(model, data, geometry, shapes, state)
            for k, pair in enumerate(geometry.collisionPairs):
                names = {self.links[pair.first], self.links[pair.second]} - {"object"}
                if len(names) == 2 or (only is not None and not names & set(only)):
                    continue
                gap = gaps.setdefault(names.pop(), np.full(len(states), np.inf))
                gap[row] = min(gap[row], self._gap(shapes, k))
        return gaps

    def _gap(self, shapes: pin.GeometryData, k: int) -> float:
        """Signed distance of a pair: of meshes that are not convex about as deep as triangles are.

        What lies wholly inside of a closed component of a mesh is deep.
        """
        pair = self.geometry.collisionPairs[k]
        pieces = self.pieces
        if not (pair.first in pieces or pair.second in pieces):
            return float(pin.computeDistance(self.geometry, shapes, k).min_distance)
        things = [self.geometry.geometryObjects[i].geometry for i in (pair.first, pair.second)]
        T = [shapes.oMg[i] for i in (pair.first, pair.second)]
        places = [coal.Transform3s(each.rotation, each.translation) for each in T]
        placed = things[0], places[0], things[1], places[1]
        gap = coal.distance(*placed, coal.DistanceRequest(), coal.DistanceResult())
        if gap <= 0.0:
            request, result = coal.CollisionRequest(), coal.CollisionResult()
            request.num_max_contacts = _CONTACTS
            coal.collide(*placed, request, result)
            depths = [result.getContact(i).penetration_depth for i in range(result.numContacts())]
            return -float(np.abs(depths).max(initial=0.0))
        for inner, outer in ((0, 1), (1, 0)):
            other = pieces.get((pair.first, pair.second)[inner])
            points = (
                [np.array(things[inner].aabb_center)]
                if other is None
                else [corners[0, 0] for corners, _ in other]
            )
            solids = pieces.get((pair.first, pair.second)[outer], [])
            points = [T[outer].actInv(T[inner].act(point)) for point in points]
            points = [point for point in points if _in_bounds(things[outer], point)]
            for corners, closed in solids if points else ():
                if closed and any(_inside(corners, point) for point in points):
                    return -_DEEP
        return float(gap)

    def sweep(
        self,
        states: Array,
        times: Array,
        approach_start: float,
        support: set[str],
        tolerances: Tolerances,
        block: int = 20,
    ) -> list[str]:
        """Collisions at the states, one sentence per pair of links and solids.

        Distances at a block's first state tell which pairs can meet within the block at all, and
        each distance how many states later the pair can meet at the earliest.
        """
        model, geometry = self.robot.model, self.geometry
        data, shapes = model.createData(), geometry.createData()
        pairs = [(p.first, p.second) for p in geometry.collisionPairs]
        for request in shapes.distanceRequests:
            request.enable_signed_distance = True
        on_support = np.array(
            [
                self.links[i] == "object"
                and self.links[j] == WORLD
                and geometry.geometryObjects[j].name.split("/", 2)[2] in support
                for i, j in pairs
            ]
        )
        found: dict[tuple[str, str], str] = {}
        reachable = 2 * (block * tolerances.step) + tolerances.penetration
        middles = [np.array(thing.geometry.aabb_center) for thing in geometry.geometryObjects]
        radii = np.array([thing.geometry.aabb_radius for thing in geometry.geometryObjects])
        both = np.array(pairs, dtype=int).reshape(-1, 2)
        next_look = np.zeros(len(pairs), dtype=int)
        next_near = np.zeros(len(pairs), dtype=int)
        for begin in range(0, len(states), block):
            pin.updateGeometryPlacements(model, data, geometry, shapes, states[begin])
            at = np.array([T.act(m) for T, m in zip(shapes.oMg, middles, strict=True)])
            between = np.linalg.norm(at[both[:, 0]] - at[both[:, 1]], axis=1)
            near = np.flatnonzero(between <= radii[both].sum(axis=1) + reachable)
            close = []
            for k in near[next_near[near] <= begin].tolist():
                gap = self._gap(shapes, k)
                if gap <= reachable:
                    close.append(k)
                else:
                    next_near[k] = begin + int((gap - reachable) / (2 * tolerances.step))
            for row in range(begin, min(begin + block, len(states))):
                pin.updateGeometryPlacements(model, data, geometry, shapes, states[row])
                for k in close:
                    if row < next_look[k]:
                        continue
                    gap = self._gap(shapes, k)
                    next_look[k] = row + 1 + int(max(gap, 0.0) / (2 * tolerances.step))
                    allowed = tolerances.penetration
                    if on_support[k] and times[row] >= approach_start - 1e-9:
                        allowed += tolerances.contact
                    if gap < -allowed:
                        names = tuple(self._name(n) for n in pairs[k])
                        found.setdefault(
                            (names[0], names[1]),
                            f"collision: {names[0]} with {names[1]} at {times[row]:.3f} s,"
                            f" {-1000 * gap:.2f} mm deep",
                        )
        too_near = self._too_near(states, times, approach_start, tolerances, block)
        return [*found.values(), *too_near]

    def _too_near(
        self,
        states: Array,
        times: Array,
        approach_start: float,
        tolerances: Tolerances,
        block: int,
    ) -> list[str]:
        """What the arm moves and brings nearer than the margin to what was measured, per link.

        Of the object on its way down its support is left out.
        """
        if self.measured is None or self.support is None:
            return []
        model, geometry = self.robot.model, self.geometry
        data, shapes = model.createData(), geometry.createData()
        request = coal.DistanceRequest()
        margin = tolerances.margin - tolerances.penetration
        corners = {i: _corners(geometry.geometryObjects[i].geometry) for i in self.moving}
        low, high = self.measured
        tree = cKDTree(0.5 * (low + high))
        largest = 0.5 * float(np.linalg.norm(high - low, axis=1).max(initial=0.0))
        worst: dict[str, tuple[float, float]] = {}
        next_look = {i: np.zeros(len(low), dtype=int) for i in self.moving}
        nearby: dict[int, npt.NDArray[np.int64]] = {}
        for row, state in enumerate(states):
            pin.updateGeometryPlacements(model, data, geometry, shapes, state)
            for i in self.moving:
                T = shapes.oMg[i]
                if row % block == 0:
                    middle = corners[i].mean(axis=0)
                    radius = float(np.linalg.norm(corners[i] - middle, axis=1).max())
                    radius += largest + margin + block * tolerances.step
                    nearby[i] = np.array(tree.query_ball_point(T.act(middle), radius), dtype=int)
                rows = nearby[i][next_look[i][nearby[i]] <= row]
                link = self.links[i]
                if link == "object" and times[row] >= approach_start - 1e-9:
                    rows = rows[~self.support[rows]]
                if len(rows) == 0:
                    continue
                points = corners[i] @ T.rotation.T + T.translation
                for axis in (2, 0, 1):
                    rows = rows[low[rows, axis] <= points[:, axis].max() + margin]
                    rows = rows[high[rows, axis] >= points[:, axis].min() - margin]
                at = coal.Transform3s(T.rotation, T.translation)
                for box in rows.tolist():
                    solid = coal.Box(high[box] - low[box])
                    where = coal.Transform3s(np.eye(3), (low[box] + high[box]) / 2)
                    thing = geometry.geometryObjects[i].geometry
                    gap = coal.distance(thing, at, solid, where, request, coal.DistanceResult())
                    center = T.actInv(pin.SE3(np.eye(3), (low[box] + high[box]) / 2)).translation
                    if _in_bounds(thing, center) and any(
                        closed and _inside(piece, center)
                        for piece, closed in self.pieces.get(i, [])
                    ):
                        gap = -_DEEP
                    next_look[i][box] = row + 1 + int(max(gap - margin, 0.0) / tolerances.step)
                    if gap < worst.get(link, (margin, 0.0))[0]:
                        worst[link] = gap, float(times[row])
        return [
            f"margin: {link} is {1000 * gap:.2f} mm from what was measured at {time:.3f} s"
            for link, (gap, time) in worst.items()
        ]

    def _name(self, index: int) -> str:
        if self.links[index] == WORLD:
            return str(self.geometry.geometryObjects[index].name.split("/", 2)[2])
        return self.links[index]


def _quintic(curve: Curve, segment: int, t: Array) -> tuple[Array, Array, Array]:
    """Position, velocity, acceleration (k, joints), t seconds into a segment."""
    h = curve.times[segment + 1] - curve.times[segment]
    p0, p1 = curve.positions[segment : segment + 2]
    v0, v1 = curve.velocities[segment : segment + 2]
    a0, a1 = curve.accelerations[segment : segment + 2]
    d = p1 - p0 - v0 * h - a0 * h**2 / 2
    e = (v1 - v0 - a0 * h) * h
    f = (a1 - a0) * h**2
    c3 = (10 * d - 4 * e + f / 2) / h**3
    c4 = (-15 * d + 7 * e - f) / h**4
    c5 = (6 * d - 3 * e + f / 2) / h**5
    s = np.asarray(t)[:, None]
    return (
        p0 + v0 * s + a0 * s**2 / 2 + c3 * s**3 + c4 * s**4 + c5 * s**5,
        v0 + a0 * s + 3 * c3 * s**2 + 4 * c4 * s**3 + 5 * c5 * s**4,
        a0 + 6 * c3 * s + 12 * c4 * s**2 + 20 * c5 * s**3,
    )


def convex(vertices: Array) -> coal.CollisionGeometry:
    """The convex hull of (n, 3) points."""
    hull = ConvexHull(vertices)
    used, triangles = np.unique(hull.simplices, return_inverse=True)
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(hull.simplices), len(used))
    mesh.addVertices(np.asarray(vertices)[used])
    for triangle in triangles.reshape(-1, 3):
        mesh.addTriangle(*vertices[used][triangle])
    mesh.endModel()
    mesh.buildConvexHull(True, "Qt")
    return mesh.convex


def _corners(shape: coal.CollisionGeometry) -> Array:
    """(n, 3) points whose hull holds a shape."""
    if isinstance(shape, coal.ConvexBase):
        return np.array([shape.point(i) for i in range(shape.num_points)])
    shape.computeLocalAABB()
    box = np.stack([shape.aabb_local.min_, shape.aabb_local.max_])
    choice = np.array(np.meshgrid(*[(0, 1)] * 3)).reshape(3, -1)
    return np.column_stack([box[choice[k], k] for k in range(3)])


def _as_convex(shape: coal.CollisionGeometry) -> coal.CollisionGeometry:
    """A convex mesh as a solid; any other shape as it is."""
    if not isinstance(shape, coal.BVHModelBase):
        return shape
    vertices, corners = _mesh(shape)
    if np.linalg.matrix_rank(vertices - vertices[0], tol=1e-6) < 3:
        return shape
    hull = ConvexHull(vertices)
    middles = vertices[corners].mean(axis=1)
    for some in (middles[:: 1 + len(middles) // 500], middles):  # most tell by a few
        inside = -(some @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
        if inside.max() >= 1e-5:
            return shape
    return convex(vertices)


def _mesh(shape: coal.BVHModelBase) -> tuple[Array, npt.NDArray[np.int64]]:
    """Vertices (n, 3) and triangles (t, 3)."""
    rows = [shape.tri_indices(i) for i in range(shape.num_tris)]
    return np.array(shape.vertices()), np.array([[r[0], r[1], r[2]] for r in rows], dtype=int)


def mesh_components(vertices: Array, triangles: npt.NDArray[np.int64]) -> list[tuple[Array, bool]]:
    """Connected components of any mesh: corners (t, 3, 3), and whether every edge is of two."""
    places, same = np.unique(vertices, axis=0, return_inverse=True)
    triangles = same.reshape(-1)[triangles]
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    ends = edges.reshape(-1, 2).T
    graph = coo_matrix((np.ones(len(ends[0])), (ends[0], ends[1])), (len(places),) * 2)
    count, label = connected_components(graph, directed=False)
    found = []
    for rows in (label[triangles[:, 0]] == k for k in range(count)):
        if rows.any():
            uses = np.unique(edges[rows].reshape(-1, 2), axis=0, return_counts=True)[1]
            found.append((places[triangles[rows]], bool((uses == 2).all())))
    return found


def _in_bounds(shape: coal.CollisionGeometry, point: Array) -> bool:
    """Whether a point (3,) is within the box around a shape, whose box is computed."""
    box = shape.aabb_local
    return bool((point >= box.min_).all() and (point <= box.max_).all())


def _inside(corners: Array, point: Array) -> bool:
    """Whether closed triangles (t, 3, 3) wind around a point (3,)."""
    if not ((point > corners.min(axis=(0, 1))) & (point < corners.max(axis=(0, 1)))).all():
        return False
    a, b, c = np.moveaxis(corners - point, 1, 0)
    na, nb, nc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=1)
    whole = na * nb * nc + (a * b).sum(axis=1) * nc + (b * c).sum(axis=1) * na
    return bool(abs(np.arctan2(volume, whole + (c * a).sum(axis=1) * nb).sum()) > np.pi)


@dataclass(frozen=True)
class Piece:
    """A connected component of the object.

    Attributes:
        corners: (t, 3, 3) of its triangles.
        closed: whether they close a solid; else they are a sheet.
        solid: whether that is convex, so that `shape` is all of it; else `shape` is the surface.
    """

    corners: Array
    closed: bool
    solid: bool
    shape: coal.CollisionGeometry


def object_pieces(vertices: Array, triangles: npt.NDArray[np.int64]) -> list[Piece]:
    """Each connected component of any mesh; by its indices, unless it is open like that."""
    vertices, triangles = np.asarray(vertices), np.asarray(triangles)
    ends = triangles[:, [0, 0]].ravel(), triangles[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(ends[0])), ends), (len(vertices),) * 2)
    label = connected_components(graph, directed=False)[1][triangles[:, 0]]
    found: list[Piece] = []
    left = []
    for k in np.unique(label):
        rows = triangles[label == k]
        edges = np.sort(rows[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        if (np.unique(edges, axis=0, return_counts=True)[1] == 2).all():
            found.append(_piece(vertices[rows], True))
        else:
            left.append(rows)
    if left:
        found += [_piece(*each) for each in mesh_components(vertices, np.vstack(left))]
    return found


def _piece(corners: Array, closed: bool) -> Piece:
    points = corners.reshape(-1, 3)
    surface = coal.BVHModelOBBRSS()
    surface.beginModel(len(corners), len(points))
    for triangle in corners:
        surface.addTriangle(*triangle)
    surface.endModel()
    surface.computeLocalAABB()
    if closed and np.linalg.matrix_rank(points - points[0], tol=1e-9) == 3:
        planes = ConvexHull(points).equations
        looked_at = np.concatenate([points, corners.mean(axis=1)])
        chunk = max(1, 2_000_000 // len(planes))
        chunks = (looked_at[row : row + chunk] for row in range(0, len(looked_at), chunk))
        if all((at @ planes[:, :3].T + planes[:, 3]).max(axis=1).min() > -1e-6 for at in chunks):
            return Piece(corners, True, True, convex(np.unique(points, axis=0)))
    return Piece(corners, closed, False, surface)


def piece_voxels(pieces: Sequence[Piece], size: float = 0.005) -> Array:
    """(n, 3) centres inside of solids, and of voxels that sheets pass through, of the voxels of a
    lattice centred on the bounding box."""
    everything = np.vstack([piece.corners.reshape(-1, 3) for piece in pieces])
    low, high = everything.min(axis=0), everything.max(axis=0)
    counts = np.ceil((high - low) / size - 1e-9)
    ticks = [
        (low[i] + high[i]) / 2 + (np.arange(counts[i]) - (counts[i] - 1) / 2) * size
        for i in range(3)
    ]
    lattice = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.zeros(len(lattice), dtype=bool)
    for piece in pieces:
        if piece.solid:
            hull = ConvexHull(piece.corners.reshape(-1, 3))
            inside |= (lattice @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1) < 1e-9
        elif piece.closed:
            inside |= _wound(piece.corners, lattice)
        else:
            tree = cKDTree(lattice)
            for a, b, c in piece.corners:
                longest = max(np.linalg.norm(b - a), np.linalg.norm(c - a), np.linalg.norm(c - b))
                ticks_ = np.linspace(0, 1, int(np.ceil(2 * longest / size)) + 2)
                u, v = (each.ravel() for each in np.meshgrid(ticks_, ticks_))
                kept = u + v <= 1 + 1e-9
                on = a + u[kept, None] * (b - a) + v[kept, None] * (c - a)
                inside[tree.query(on, p=np.inf)[1]] = True
    return np.asarray(lattice[inside])


def _wound(corners: Array, points: Array) -> npt.NDArray[np.bool_]:
    """Which points (n, 3) closed triangles (t, 3, 3) wind around."""
    found = np.zeros(len(points), dtype=bool)
    chunk = max(1, 1_000_000 // len(corners))
    for row in range(0, len(points), chunk):
        away = corners[None] - points[row : row + chunk, None, None]
        a, b, c = (away[:, :, k] for k in range(3))
        na, nb, nc = (np.linalg.norm(each, axis=2) for each in (a, b, c))
        volume = (a * np.cross(b, c)).sum(axis=2)
        whole = na * nb * nc + (a * b).sum(axis=2) * nc + (b * c).sum(axis=2) * na
        turned = np.arctan2(volume, whole + (c * a).sum(axis=2) * nb).sum(axis=1)
        found[row : row + chunk] = np.abs(turned) > np.pi
    return found


def convex_components(vertices: Array, triangles: npt.NDArray[np.int64]) -> list[Array]:
    """Vertices (k, 3) of each connected component of a mesh.

    Raises:
        ValueError: a component is not convex.
    """
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (len(vertices),) * 2)
    count, label = connected_components(graph, directed=False)
    result = []
    for k in range(count):
        points = np.asarray(vertices)[label == k]
        hull = ConvexHull(points)
        depth = -(points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
        if depth.max() > 1e-6:
            raise ValueError(f"component {k} of the object is not convex")
        result.append(points)
    return result


def voxel_centres(components: Sequence[Array], size: float = 0.005) -> Array:
    """(n, 3) centres inside a solid, of the voxels of a lattice centred on the bounding box."""
    everything = np.vstack(components)
    low, high = everything.min(axis=0), everything.max(axis=0)
    counts = np.ceil((high - low) / size - 1e-9)
    ticks = [
        (low[i] + high[i]) / 2 + (np.arange(counts[i]) - (counts[i] - 1) / 2) * size
        for i in range(3)
    ]
    lattice = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.zeros(len(lattice), dtype=bool)
    for points in components:
        hull = ConvexHull(points)
        inside |= (lattice @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1) < 1e-9
    return np.asarray(lattice[inside])


def upright_prisms(vertices: Array, thickness: float = 0.002) -> list[tuple[Array, float, float]]:
    """A convex solid as upright prisms: outline (k, 2) counter-clockwise, bottom, top.

    Exact where it is one; else slices, each as wide as its wider end.
    """
    z = vertices[:, 2]
    low, high = float(z.min()), float(z.max())
    bottom, top = vertices[z < low + 1e-9], vertices[z > high - 1e-9]
    if len(bottom) + len(top) == len(vertices) and len(bottom) == len(top) >= 3:
        outlines = [c[ConvexHull(c[:, :2]).vertices, :2] for c in (bottom, top)]
        if all(np.linalg.norm(outlines[1] - p, axis=1).min() < 1e-9 for p in outlines[0]):
            return [(outlines[0], low, high)]
    levels = np.linspace(low, high, int(np.ceil((high - low) / thickness)) + 1)
    a, b = (index.ravel() for index in np.meshgrid(*[np.arange(len(vertices))] * 2))
    rising = z[b] - z[a] > 1e-12
    a, b = a[rising], b[rising]
    cuts = []
    for level in levels:
        crossing = (z[a] <= level) & (z[b] >= level)
        p, r = vertices[a[crossing]], vertices[b[crossing]]
        share = ((level - p[:, 2]) / (r[:, 2] - p[:, 2]))[:, None]
        cuts.append((p + share * (r - p))[:, :2])
    result = []
    for i in range(len(levels) - 1):
        both = np.vstack([cuts[i], cuts[i + 1]])
        result.append((both[ConvexHull(both).vertices], float(levels[i]), float(levels[i + 1])))
    return result


def _clip(outline: Array, lower: Array, upper: Array) -> Array:
    """A convex polygon's part within a rectangle (Sutherland–Hodgman); (0, 2) where none is."""
    for axis in (0, 1):
        for sign, bound in ((1.0, upper[axis]), (-1.0, -lower[axis])):
            kept: list[Array] = []
            for p, r in zip(outline, np.roll(outline, -1, axis=0), strict=True):
                dp, dr = sign * p[axis] - bound, sign * r[axis] - bound
                if dp <= 0:
                    kept.append(p)
                if dp * dr < 0:
                    kept.append(p + dp / (dp - dr) * (r - p))
            if not kept:
                return np.empty((0, 2))
            outline = np.array(kept)
    return outline


def _lower_distance(
    best: Array,
    points: Array,
    outline: Array,
    low: float,
    high: float,
    volume_lower: Array,
    volume_upper: Array,
) -> None:
    """Lower `best` (n,) to the distance sideways and upwards to a prism's part in V."""
    low, high = max(low, volume_lower[2]), min(high, volume_upper[2])
    outline = _clip(outline, volume_lower, volume_upper)
    if low >= high or len(outline) < 3:
        return
    rise = np.maximum(low - points[:, 2], 0.0)
    box = np.maximum(outline.min(axis=0) - points[:, :2], points[:, :2] - outline.max(axis=0))
    rows = np.flatnonzero(
        (points[:, 2] <= high) & (np.hypot(np.hypot(*np.maximum(box, 0).T), rise) < best)
    )
    xy = points[rows, :2]
    edges = np.roll(outline, -1, axis=0) - outline
    relative = xy[:, None] - outline
    inside = (edges[:, 0] * relative[..., 1] - edges[:, 1] * relative[..., 0] >= 0).all(axis=1)
    length = np.maximum((edges**2).sum(axis=1), 1e-18)
    along = np.clip((relative * edges).sum(axis=2) / length, 0, 1)
    sideways = np.linalg.norm(relative - along[..., None] * edges, axis=2).min(axis=1)
    distance = np.hypot(np.where(inside, 0.0, sideways), rise[rows])
    best[rows] = np.minimum(best[rows], distance)
