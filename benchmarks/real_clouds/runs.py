"""Every bundled object placed on the table of a real cloud, held against its points."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial import KDTree

from benchmarks.real_clouds.table import TableCloud
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem, workspace
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.visibility import View
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.yumi import load_yumi, start_configuration, yumi_arm

_ROBOT = 0.12
"""m ahead of the robot's middle within which points are taken to be its own."""


@dataclass(frozen=True, slots=True, eq=False)
class RealRun:
    """What became of one object on one cloud.

    Attributes:
        pose: T_world_object of the last placement; None where there is none.
        seconds: of processor time to the first, the environment's construction included.
        deepest: m that any measured point lies inside of the object, noise of the table included.
        farthest: m from a vertex that the object stands on to the nearest measured point.
    """

    thing: str
    pose: pin.SE3 | None
    seconds: float
    failure: str = ""
    deepest: float = 0.0
    farthest: float = 0.0


def place_on(cloud: TableCloud, thing: str, seconds: float, seed: int) -> RealRun:
    """Plan for one object, for so many seconds of processor time or until the second placement."""
    robot, held = load_yumi(), object_by_name(thing)
    arms = tuple(yumi_arm(robot, name, grasps) for name, grasps in held.grasps.items())
    q_start = robot.configuration(start_configuration(thing))
    body = Body.from_mesh(held.vertices, held.triangles, held.center_of_mass)
    points = cloud.points[cloud.points[:, 0] > _ROBOT]
    started = time.process_time()
    bounds = workspace(robot, arms, q_start, body, cloud.volume)
    sights = [View(points, cloud.sensor)]
    environment = Environment.from_points(points, cloud.volume, bounds=bounds, sights=sights)
    problem = Problem(robot, arms, q_start, body, cloud.volume, environment)
    objective = make_objective(
        "maximize_clearance", ObjectiveContext(environment, cloud.volume, body)
    )
    planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(seed))
    pose, first, number = None, 0.0, 0
    for placement in planner.run(lambda: time.process_time() - started > seconds):
        pose, number = placement.T_world_object, number + 1
        first = first or time.process_time() - started
        if number == 2:
            break
    if pose is None:
        return RealRun(thing, None, 0.0, planner.exhausted or planner.explain().short)
    return RealRun(thing, pose, first, "", *_against(points, thing, pose))


def _against(points: np.ndarray, thing: str, pose: pin.SE3) -> tuple[float, float]:
    """`deepest` and `farthest` of an object at a pose."""
    held = object_by_name(thing)
    seen = (points - pose.translation) @ pose.rotation
    around = (np.abs(points - pose.translation) < 0.3).all(axis=1)
    seen = seen[around]
    deepest = max(float(part.depth(seen).max(initial=0.0)) for part in held.parts)
    vertices = held.vertices @ pose.rotation.T + pose.translation
    feet = vertices[vertices[:, 2] < vertices[:, 2].min() + 1e-3]
    return deepest, float(KDTree(points[around]).query(feet)[0].max())
