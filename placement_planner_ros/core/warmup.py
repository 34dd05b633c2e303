"""Compile (or load from cache) every kernel before the first search needs it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
import trimesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.load import Held
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.grasp.open_hand import OpenHand
from placement_planner_ros.core.motion.birrt import GoalSetRRT
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import ObjectiveContext, gradient
from placement_planner_ros.core.plan_motion.withdrawal import straight_way
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.reach.seeds import seed_table
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.scene.visibility import View, unknown_cells
from placement_planner_ros.core.search.hierarchy import AfrHierarchy, HierarchySettings
from placement_planner_ros.core.search.tree import SearchTree
from placement_planner_ros.core.swept.space import Stretch, SweptSpace
from placement_planner_ros.core.timing.timing import parameterize
from placement_planner_ros.core.types import Array, TargetVolume, Verdict


def warm_up(robot: Robot, arms: Sequence[Arm], q_robot: Array) -> None:
    """Call each stage once on a cube over a small noisy surface.

    It also fills the caches that depend on the robot alone, such as the spheres over its links.

    Args:
        q_robot: (nq,) any configuration of the robot.
    """
    rng = np.random.default_rng(0)
    settings = PlannerSettings()
    cube = trimesh.creation.box((0.01, 0.01, 0.01))
    body = Body.from_mesh(cube.vertices, cube.faces)
    for arm in arms:
        chain = Chain.from_robot(robot, arm, q_robot)
        q = q_robot[arm.q_index]
        x = pin.SE3(chain.forward(q))
        environment, volume = _surface_below(x.translation, rng)
        arm = replace(
            arm, grasps=(pin.SE3.Identity(),), touch_links=tuple(set(robot.geometry_links))
        )
        problem = Problem(robot, (arm,), q_robot, body, volume, environment)
        poses = PoseConstraints(
            problem, settings.collision, settings.edge_margin, settings.approach.approach_minimum
        )
        moving, obstacles = MovingArm(robot, arm, q_robot), environment.obstacles
        grasping = replace(settings.grasp, require_retreat=False)
        open_hand = OpenHand(moving, body, obstacles, grasping)
        holding = Holding(moving, Held(body), obstacles, open_hand, grasping)
        tip = x.homogeneous
        inverse = InverseKinematics(chain, settings.ik)
        inverse.sweep(tip, q[None])
        inverse.solve(tip, seed_table(chain).near(tip[None], 2, rng)[0])
        reached = holding.configurations(x, 8, rng)
        # Whether or not the robot as it is may hold a thing there, the same is called.
        found = q if isinstance(reached, Verdict) else reached[0]
        holding.placing_motion(found, x, x.translation[2], poses)
        open_hand.release_free(found)
        open_hand.retreat(found, 0, x)
        straight_way(holding, found)
        chain.jacobian(found, np.eye(4))
        holding.collision.explain(found)
        holding.transit_free(found, q)
        swept = SweptSpace([Stretch("", holding.collision, np.array([q, q]))], obstacles, 0.01)
        swept.news(x.translation + rng.normal(0.0, 0.01, (10, 3)))
        swept.first_hit(x.translation + rng.normal(0.0, 0.01, (10, 3)))
        for region in environment.regions[:1]:
            for part in region.split():
                part.split()
        poses.verdict(x, 0, x.translation[2])
        poses.stable(x, 0)
        poses.free(x, x.translation[2])
        context = ObjectiveContext(environment, volume, body)
        objective = make_objective("maximize_clearance", context)
        objective(x)
        gradient(objective, x)
        parameterize(
            np.array([q, q + 0.1, q]), arm.joints, arm.velocity, arm.velocity, _always_free
        )
    tree = SearchTree(AfrHierarchy([1], 1, (), HierarchySettings()), 3, 0.5, 100, rng)
    for _ in range(10):
        tree.update(tree.select(), 1.0, 1.0, 0.0)
    square = (np.zeros(2), np.ones(2))
    trees = GoalSetRRT(*square, np.zeros(2), _always_free, settings.transit.rrt, rng)
    trees.add_goal(0, np.ones(2))
    trees.solve(10)


def _surface_below(point: Array, rng: np.random.Generator) -> tuple[Environment, TargetVolume]:
    """A noisy level patch, 0.2 m wide, 0.2 m below a point, with a step on it."""
    grid = np.stack(np.meshgrid(*[np.arange(-0.1, 0.1, 0.0025)] * 2), axis=-1).reshape(-1, 2)
    heights = np.where(grid[:, 0] > 0.05, 0.05, 0.0) + rng.normal(0.0, 0.002, len(grid))
    points = point + np.column_stack([grid, heights - 0.2])
    volume = TargetVolume(point - 0.3, point + 0.3)
    bounds = (volume.lower, volume.upper)
    environment = Environment.from_points(points, volume, GridSettings(), RegionSettings(), bounds)
    unknown_cells(environment.measured, [View(points, point)], volume)
    return environment, volume


def _always_free(*_: Array) -> bool:
    return True
