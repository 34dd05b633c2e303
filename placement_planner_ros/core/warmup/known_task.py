"""A placement task that is solved for its own sake: whoever has seen it calls no new kernel.

A small made-up robot with joints and shapes of every kind puts down a box on a surface below it,
where it is known to be free and to find a way: once with each sampler, then a hollow thing, then
where nothing can be placed. So every stage of a search is passed, whatever robot the user has and
wherever that stands.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
import pinocchio as pin
import trimesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.carry.settings import CarrySettings, TiltLimit
from placement_planner_ros.core.carry.tilt import TiltConstraint
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.collision.mesh_distances import SolidSurface, rows_in_boxes
from placement_planner_ros.core.contacts.protrusions import Protrusions
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import ObjectiveContext, objective_gradient
from placement_planner_ros.core.planner import SAMPLERS, PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem, workspace
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.reach.seeds import seed_table
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.scene.cloud import cropped
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.flying_pixels import flying_pixels
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.core.swept.space import Stretch, SweptSpace
from placement_planner_ros.core.types import LEVEL, Array, Placement, TargetVolume
from placement_planner_ros.core.warmup.known_robot import START, known_robot
from placement_planner_ros.core.wishes.settings import TurnSettings

TASK_SAMPLES = 4000
"""Samples within which a task must be solved, or be known to be hopeless."""


class WarmupError(PlacementPlannerError):
    """A stage of the search was not passed."""

    code = "INTERNAL"


class KnownTask:
    """The task, and the stages of a search over it; each makes what it needs of those before."""

    def __init__(self) -> None:
        self._robot, self._arm = known_robot()
        self._q = self._robot.with_positions(np.zeros(self._robot.model.nq), START)
        self._moving = MovingArm(self._robot, self._arm, self._q)
        self._box = _body_of_mesh(trimesh.creation.box((0.06, 0.06, 0.1)))

    def solve(self) -> None:
        """Pass all stages.

        Raises:
            WarmupError: a stage was not passed.
        """
        for stage in STAGES:
            stage(self)

    def reach(self) -> None:
        """Inverse kinematics, with the self-motions that only some searches need."""
        # Solve, walk along self-motions and follow.
        chain = Chain.from_robot(self._robot, self._arm, self._q)
        q = self._q[self._arm.q_index]
        tip = chain.forward(q)
        inverse = InverseKinematics(chain, PlannerSettings().ik)
        inverse.solve(tip, seed_table(chain).near(tip[None], 2, _stage_rng())[0])
        inverse.sweep(tip, q[None])
        inverse.track([tip, tip], q)
        chain.jacobian(q, np.eye(4))

    def configurations(self) -> None:
        """Configurations that are free or not, and why not."""
        arm, q = self._holding_arm(), self._q[self._arm.q_index]
        arm.free_batch(q[None])
        arm.explain(q)

    def hands(self) -> None:
        """Hands that are free or not."""
        chain = Chain.from_robot(self._robot, self._arm, self._q)
        self._holding_arm().hand_collides(chain.forward(self._q[self._arm.q_index]), 0.0)

    def edges(self) -> None:
        """Edges that are free or not."""
        arm, q = self._holding_arm(), self._q[self._arm.q_index]
        arm.edge_free(q, q + 0.01)

    def distances(self) -> None:
        """Clearance and its gradient; how far surfaces go on, and what rises from them."""
        # Clearance at a pose, and its gradient.
        context = ObjectiveContext(self._environment, self._environment.volume, self._box)
        objective = make_objective("maximize_clearance", context)
        objective_gradient(objective, _translated_pose(0.05, 0.05, 0.06))
        self._environment.clearance.distance(np.zeros((1, 3)))
        self._environment.clearance.envelope(1.0)
        # Support, and what rises from it.
        support = self._environment.support
        support.supported(np.zeros((1, 3)), 0.003, 0.05)
        one, far_below = (
            _translated_pose(0.05, 0.05, 0.06).homogeneous[None],
            np.array([[-10.0, 0.0, 0.0]]),
        )
        rises = Protrusions(self._environment, self._box.faces, lambda _: np.zeros((1, 2)), 0.003)
        none = np.zeros(1)
        rises.lift(one, np.zeros(1, np.int64), LEVEL, far_below, none, none)

    def swept(self) -> None:
        """What a path sweeps, against a cloud."""
        arm, q = self._holding_arm(), self._q[self._arm.q_index]
        swept = SweptSpace([Stretch("", arm, np.array([q, q]))], self._obstacles, 0.01)
        near = _stage_rng().normal([0.0, 0.0, 0.3], 0.2, (1000, 3))
        swept.news(near)
        swept.first_hit(near)

    def carry(self) -> None:
        """Configurations and edges that keep the object upright."""
        # The object may lean, but little.
        chain = Chain.from_robot(self._robot, self._arm, self._q)
        limit = TiltLimit(self._up(), 0.1)
        upright = TiltConstraint(chain, self._arm.grasps[0].rotation, limit)
        q = self._q[self._arm.q_index]
        upright.project(q + 0.2)
        upright.keeps(q, q + 0.01)
        upright.keeps_timed(q, q + 0.01, np.full(chain.dof, 0.01))

    def self_filter(self) -> None:
        """Which points of a cloud belong to a surface, and which are far from all that matters."""
        # A box stands for any surface.
        surface = SolidSurface.of(self._box.vertices[self._box.triangles])
        surface.distances(np.zeros((1, 3)), 0.01)
        rows_in_boxes(np.zeros((1, 3)), np.zeros((1, 2, 3)))
        cropped(np.zeros(3), np.ones(3), np.zeros((1, 3)), 1.0)

    def samplers(self) -> None:
        """A placement by each sampler."""
        for sampler in SAMPLERS:
            self._place(self._problem, replace(PlannerSettings(), sampler=sampler))

    def settings(self) -> None:
        """Support by polygons, and an object that is kept upright and jerked little."""
        self._place(self._problem, replace(PlannerSettings(), support="polygon"))
        self._place(self._problem, self._carefully())

    def hollow_object(self) -> None:
        """A placement of what is not convex."""
        self._place(replace(self._problem, body=_body_of_mesh(_tray_mesh())), PlannerSettings())

    @functools.cached_property
    def _environment(self) -> Environment:
        return _noisy_surroundings(self._robot, self._arm, self._q, self._box, _stage_rng())

    @functools.cached_property
    def _problem(self) -> Problem:
        around = self._environment
        return Problem(self._robot, (self._arm,), self._q, self._box, around.volume, around)

    def _holding_arm(self) -> ArmCollision:
        return ArmCollision(self._moving, AttachedObject(self._box), self._obstacles)

    @functools.cached_property
    def _obstacles(self) -> ObstacleSet:
        """Few, for what needs nothing of the environment: another process compiles that."""
        return ObstacleSet.from_points(_level_points(0.03, 0.03, 0.0))

    def _carefully(self) -> PlannerSettings:
        """Settings that keep the object as upright as it is held at first, and jerk it little."""
        carry = CarrySettings(max_tilt=0.5, max_acceleration=1.0)
        up = tuple(self._up().tolist())
        return replace(PlannerSettings(), carry=carry, turns=TurnSettings(up=up))

    def _up(self) -> Array:
        """What points upwards at first, in the object's frame."""
        chain = Chain.from_robot(self._robot, self._arm, self._q)
        tip = chain.forward(self._q[self._arm.q_index])[:3, :3]
        up: Array = (tip @ self._arm.grasps[0].rotation)[2]
        return up

    def _place(self, problem: Problem, settings: PlannerSettings) -> None:
        """A placement, and a second one where better ones are sought at once."""
        # Until one is found, or two.
        context = ObjectiveContext(problem.environment, problem.volume, problem.body)
        objective = make_objective("maximize_clearance", context)
        planner = PlacementPlanner(problem, objective, settings, _stage_rng())
        wanted = 2 if settings.sampler == SAMPLERS[0] else 1
        found = list(islice(_bounded_run(planner), wanted))
        if not found or found[-1].retreat is None:
            raise WarmupError("warmup", settings.sampler, f"found nothing: {planner.explain()}")
        planner.explain()

    def search_in_vain(self) -> None:
        """Where support is out of reach, and where it is too narrow."""
        inside = self._environment.volume
        # Surfaces where nothing can be placed.
        for away, width, name in ((4.0, 0.06, "out of reach"), (0.0, 0.02, "too narrow")):
            offset = np.array([away, 0.0, 0.0])
            volume = TargetVolume(inside.lower + offset, inside.upper + offset)
            environment = Environment.from_points(_level_points(0.06, width, 0.0) + offset, volume)
            there = replace(self._problem, volume=volume, environment=environment)
            context = ObjectiveContext(environment, volume, self._box)
            objective = make_objective("maximize_clearance", context)
            planner = PlacementPlanner(there, objective, PlannerSettings(), _stage_rng())
            if any(_bounded_run(planner)):
                raise WarmupError("warmup", name, "something was placed where nothing can be")
            planner.explain()


STAGES = (
    KnownTask.configurations,
    KnownTask.edges,
    KnownTask.swept,
    KnownTask.carry,
    KnownTask.samplers,
    KnownTask.distances,
    KnownTask.self_filter,
    KnownTask.reach,
    KnownTask.hands,
    KnownTask.settings,
    KnownTask.hollow_object,
    KnownTask.search_in_vain,
)
"""Stages of a search. Those of the robot and of the scene take as long as each other: who begins in
the middle has most of what the others compile later."""


def _stage_rng() -> np.random.Generator:
    """The same draws for each stage, whichever come before it."""
    return np.random.default_rng(0)


def _bounded_run(planner: PlacementPlanner) -> Iterator[Placement]:
    return planner.run(lambda: planner.statistics.samples >= TASK_SAMPLES)


def _noisy_surroundings(
    robot: Robot, arm: Arm, q_start: Array, body: Body, rng: np.random.Generator
) -> Environment:
    """A noisy level surface with a block on it.

    Another is made with what a sensor above does not see, and with a gap that it sees through.
    """
    # A surface and a block, as a camera sees them.
    block = _level_points(0.03, 0.03, 0.06) + np.array([0.15, 0.15, 0.0])
    points = rng.normal(np.vstack([_level_points(0.25, 0.25, 0.0), block]), 0.001)
    volume = TargetVolume(np.array([-0.25, -0.25, -0.05]), np.array([0.25, 0.25, 0.3]))
    bounds = workspace(robot, (arm,), q_start, body, volume)
    settings = GridSettings()
    eye = np.array([0.0, 0.0, 1.5])
    # What is seen from above, with a gap.
    seen = points[~flying_pixels(points, eye)]
    seen[np.hypot(seen[:, 0] + 0.15, seen[:, 1] + 0.15) < 0.05, 2] -= 0.15
    sights = [View(seen, eye)]
    Environment.from_points(seen, volume, settings, None, bounds, sights=sights).with_unknown()
    return Environment.from_points(points, volume, settings, None, bounds)


def _level_points(length: float, width: float, height: float) -> Array:
    """Points (n, 3) of a rectangle of twice that length and width around the origin."""
    # Points every 5 mm.
    spacing = 0.005
    x, y = (np.arange(-half, half + spacing, spacing) for half in (length, width))
    flat = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.column_stack([flat, np.full(len(flat), height)])


def _translated_pose(x: float, y: float, z: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def _body_of_mesh(mesh: trimesh.Trimesh) -> Body:
    return Body.from_mesh(mesh.vertices, mesh.faces)


def _tray_mesh() -> trimesh.Trimesh:
    """A flat open box, a single closed mesh."""
    # Rings of the outer and the inner wall.
    outline = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
    rings = [(0.03, 0.0), (0.03, 0.04), (0.024, 0.04), (0.024, 0.005)]
    vertices = np.vstack([np.column_stack([outline * r, np.full(4, z)]) for r, z in rings])
    faces = [[0, 3, 2], [0, 2, 1], [12, 13, 14], [12, 14, 15]]
    for ring in (0, 4, 8):
        for k in range(4):
            a, b = ring + k, ring + (k + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    return trimesh.Trimesh(vertices, faces, process=False)
