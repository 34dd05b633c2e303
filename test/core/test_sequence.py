"""Four objects placed one after the other, each becoming obstacle and support for the next."""

from dataclasses import replace

import numpy as np
from checker import Solution
from helpers.tasks import yumi_checker, yumi_task

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem, workspace
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.primitives import ConvexPrimitive
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import load_yumi, start_configuration, yumi_arm

ORDER = ("large_crayons_box", "small_crayons_box", "toy_table", "wine_glass")
OBJECTIVE = "minimize_clearance"
SAMPLES = 1200


def problem_among(scene, held, robot):
    """The task of placing an object into a scene that is seen completely."""
    arms = tuple(yumi_arm(robot, name, grasps) for name, grasps in held.grasps.items())
    body = Body.from_mesh(held.vertices, held.triangles, held.center_of_mass)
    q_start = robot.configuration(start_configuration(held.name))
    environment = Environment.from_points(
        complete_cloud(scene),
        scene.volume,
        bounds=workspace(robot, arms, q_start, body, scene.volume),
        beyond_volume=False,
    )
    return Problem(robot, arms, q_start, body, scene.volume, environment)


def with_placed(scene, held, T_world_object):
    """The scene with the object's solids where it was placed."""
    solids = tuple(
        ConvexPrimitive(
            part.name, part.vertices @ T_world_object.rotation.T + T_world_object.translation
        )
        for part in held.parts
    )
    return replace(scene, parts=scene.parts + solids)


def test_four_objects_one_after_the_other():
    scene, robot = scene_by_name("cabinet_low_clutter"), load_yumi()
    for number, name in enumerate(ORDER):
        held = object_by_name(name)
        problem = problem_among(scene, held, robot)
        objective = make_objective(
            OBJECTIVE, ObjectiveContext(problem.environment, problem.volume, problem.body)
        )
        planner = PlacementPlanner(
            problem, objective, PlannerSettings(), np.random.default_rng(number)
        )
        placements = list(planner.run(lambda p=planner: p.statistics.samples >= SAMPLES))
        assert placements, f"{name}: {planner.explain().short}"
        best = placements[-1]
        arm = next(arm for arm in problem.arms if arm.name == best.goal.arm)
        checker = yumi_checker(yumi_task(scene, held, OBJECTIVE))
        assert checker.check(Solution.of(best, arm)) == []
        scene = with_placed(scene, held, best.T_world_object)
    assert len(scene.parts) > len(scene_by_name("cabinet_low_clutter").parts) + len(ORDER)
