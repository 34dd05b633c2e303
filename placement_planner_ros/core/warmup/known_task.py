"""A small placement task that is solved for its own sake: who has solved it calls no new kernel.

A gantry with a wrist puts a piece of a tube down on a surface that a camera above sees, where it is
known to find a way, then finds none where nothing can be reached. What runs call besides a search,
as for clouds that come meanwhile, is called directly. Kernels are the same whatever robot the user
has.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from itertools import islice

import numpy as np
import trimesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.carry.settings import CarrySettings, TiltLimit
from placement_planner_ros.core.carry.tilt import TiltConstraint
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.collision.mesh_distances import SolidSurface, rows_in_boxes
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.measured_points import measured_points
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem, workspace
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.flying_pixels import flying_pixels
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.core.swept.space import Stretch, SweptSpace
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.core.wishes.settings import TurnSettings

TASK_SAMPLES = 4000
"""Samples within which a task must be solved, or be known to be hopeless."""

_LINKS = (
    ("base", "fixed", "0 0 1", "0 0", 'box size="0.2 0.2 0.4"', "-0.8 0 0.2"),
    ("bridge", "prismatic", "0 1 0", "-0.5 0.5", 'box size="0.1 0.1 0.1"', "-0.8 0 1.1"),
    ("beam", "prismatic", "1 0 0", "-0.2 0.2", 'sphere radius="0.03"', "0 0 1.3"),
    ("column", "prismatic", "1 0 0", "-0.5 0.5", 'cylinder radius="0.03" length="0.2"', "0 0 1.1"),
    ("mast", "prismatic", "0 0 1", "-0.45 0.05", 'sphere radius="0.03"', "0 0 0.8"),
    ("wrist_1", "continuous", "0 0 1", "0 0", 'box size="0.04 0.04 0.04"', "0 0 0.69"),
    ("wrist_2", "revolute", "0 1 0", "-0.6 0.6", 'sphere radius="0.02"', "0 0 0.55"),
    ("hand", "revolute", "1 0 0", "-0.6 0.6", 'box size="0.14 0.05 0.03"', "0 0 0.47"),
)
"""One after the other: name, kind, axis and limits of the joint before it, shape, and where that
is; rad and m."""
_UP = (0.0, 0.0, 1.0)
"""Of the object, as it is held at first."""
_VOLUME = np.array([[-0.25, -0.25, -0.05], [0.25, 0.25, 0.3]])
"""(2, 3) m, corners of V."""


class WarmupError(PlacementPlannerError):
    """The known task was not solved."""

    code = "INTERNAL"


class KnownTask:
    """The task in stages, which can be passed in any order.

    Raises:
        WarmupError: a stage was not passed.
    """

    def __init__(self) -> None:
        # The robot holds a piece of a tube, from above.
        self._robot = Robot.from_urdf(_urdf_text())
        grasp = np.eye(4)
        grasp[2, 3] = 0.36
        self._arm = self._robot.arm("arm", "hand", grasps=[grasp])
        self._q = self._robot.configuration(dict.fromkeys(self._robot.joint_names, 0.0))
        tube = trimesh.creation.annulus(0.015, 0.03, 0.1, sections=8)
        self._body = Body.from_mesh(tube.vertices, tube.faces)

    def solve(self) -> None:
        """Pass all stages."""
        for stage in STAGES:
            stage(self)

    def move_arm(self) -> None:
        """Edges that are free or not, what they sweep, and motions with a pose kept."""
        chain, q = Chain.from_robot(self._robot, self._arm, self._q), self._q[self._arm.q_index]
        cloud = _level_points(0.03)
        moving = MovingArm(self._robot, self._arm, self._q)
        obstacles = ObstacleSet.from_points(cloud)
        arm = ArmCollision(moving, AttachedObject(self._body), obstacles)
        arm.edge_free(q, q + 0.01)
        swept = SweptSpace([Stretch("", arm, np.array([q, q]))], obstacles, 0.01)
        swept.first_hit(cloud[swept.news(cloud)])
        InverseKinematics(chain, PlannerSettings().ik).sweep(chain.forward(q), q[None])
        TiltConstraint(chain, np.eye(3), TiltLimit(np.array(_UP), 0.1)).project(q + 0.2)

    def look_around(self) -> None:
        """The surroundings with what is not seen of them, and distances in them."""
        clearance = self._environment.with_unknown().clearance
        clearance.distance(np.zeros((1, 3)))
        clearance.envelope(1.0)

    def filter_cloud(self) -> None:
        """Which points of a cloud are measurements, which belong to a surface, and which are far
        from all that matters."""
        one = np.ones(1)
        measured_points((one, one, one), np.eye(4), 1.0)
        surface = SolidSurface.of(self._body.vertices[self._body.triangles])
        surface.distances(np.zeros((1, 3)), 0.01)
        rows_in_boxes(np.zeros((1, 3)), np.zeros((1, 2, 3)))

    def search(self) -> None:
        """Two placements, then one by other means, with the object kept upright."""
        plain = PlannerSettings()
        careful = replace(
            plain,
            sampler="mcts",
            support="polygon",
            carry=CarrySettings(max_tilt=0.5, max_acceleration=1.0),
            turns=TurnSettings(up=_UP),
        )
        for settings, wanted in ((plain, 2), (careful, 1)):
            self._place(self._environment, settings, wanted)

    def search_in_vain(self) -> None:
        """None on a surface that is out of reach."""
        far = np.array([4.0, 0.0, 0.0])
        volume = TargetVolume(_VOLUME[0] + far, _VOLUME[1] + far)
        self._place(
            Environment.from_points(_level_points(0.06) + far, volume), PlannerSettings(), 0
        )

    @cached_property
    def _environment(self) -> Environment:
        """A noisy level surface with a block on it, and a hole that a camera above sees through."""
        block = _level_points(0.03) + np.array([0.15, 0.15, 0.06])
        points = np.vstack([_level_points(0.25), block])
        points[np.hypot(points[:, 0] + 0.15, points[:, 1] + 0.15) < 0.05, 2] -= 0.15
        eye = np.array([0.0, 0.0, 1.5])
        points = _stage_rng().normal(points, 0.001)
        points = points[~flying_pixels(points, eye)]
        volume = TargetVolume(*_VOLUME)
        around = workspace(self._robot, (self._arm,), self._q, self._body, volume)
        sights = [View(points, eye)]
        return Environment.from_points(points, volume, GridSettings(), None, around, sights=sights)

    def _place(self, environment: Environment, settings: PlannerSettings, wanted: int) -> None:
        """Find as many placements as wanted; one at least is found where one is wanted."""
        volume = environment.volume
        problem = Problem(self._robot, (self._arm,), self._q, self._body, volume, environment)
        context = settings.context(environment, volume, self._body)
        objective = make_objective("maximize_clearance", context)
        planner = PlacementPlanner(problem, objective, settings, _stage_rng())
        run = planner.run(lambda: planner.statistics.samples >= TASK_SAMPLES)
        found = list(islice(run, max(wanted, 1)))
        if bool(found) != bool(wanted):
            raise WarmupError(
                "warmup", settings.sampler, f"found {len(found)}: {planner.explain()}"
            )
        planner.explain()


STAGES = (
    KnownTask.search,
    KnownTask.look_around,
    KnownTask.move_arm,
    KnownTask.filter_cloud,
    KnownTask.search_in_vain,
)
"""A search begins with the surroundings: who begins with the arm has most of what others compile
later."""


def _stage_rng() -> np.random.Generator:
    """The same draws for each stage, whichever come before it."""
    return np.random.default_rng(0)


def _level_points(half: float) -> Array:
    """(n, 3) points of a square around the origin, 5 mm apart."""
    x, y = np.mgrid[-half : half + 0.005 : 0.005, -half : half + 0.005 : 0.005].reshape(2, -1)
    return np.column_stack([x, y, np.zeros(len(x))])


def _urdf_text() -> str:
    parts = ['<robot name="known"><link name="world"/>']
    parent = "world"
    for name, kind, axis, limits, shape, place in _LINKS:
        lower, upper = limits.split()
        parts.append(
            f'<link name="{name}"><collision><origin xyz="{place}"/><geometry><{shape}/></geometry>'
            f'</collision></link><joint name="to_{name}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{name}"/><axis xyz="{axis}"/>'
            f'<limit lower="{lower}" upper="{upper}" velocity="1" effort="1"/></joint>'
        )
        parent = name
    return "".join([*parts, "</robot>"])
