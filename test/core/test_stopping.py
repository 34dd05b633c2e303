"""What is made before a search can be given up between any two of its steps."""

from dataclasses import replace

import numpy as np
import pytest

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.stopping import StoppedError, step, stoppable
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm

VOLUME = TargetVolume(np.array([0.2, -0.3, -0.1]), np.array([0.6, 0.3, 0.2]))
TABLE = np.stack(np.meshgrid(np.arange(0.2, 0.6, 0.005), np.arange(-0.3, 0.3, 0.005)), -1)
TABLE = np.column_stack([TABLE.reshape(-1, 2), np.zeros(TABLE.size // 2)])


class Looks:
    """Says stop from the look after so many on."""

    def __init__(self, allowed):
        self.allowed = allowed
        self.count = 0

    def __call__(self):
        self.count += 1
        return self.count > self.allowed


def test_a_step_goes_on_where_nobody_may_lose_interest():
    step("anything")


def test_a_step_ends_the_work_once_told_and_only_within():
    with stoppable(lambda: False):
        step("the first")
        with pytest.raises(StoppedError, match="the second"), stoppable(lambda: True):
            step("the second")
        step("the third")
    step("the fourth")


def held():
    thing = object_by_name("small_crayons_box")
    return thing.grasps["left"], Body.from_mesh(
        thing.vertices, thing.triangles, thing.center_of_mass
    )


def test_every_stage_of_making_a_planner_can_be_given_up():
    robot = load_yumi()
    grasps, body = held()
    # Another name than elsewhere: nothing of this arm is remembered from other tests.
    arm = replace(yumi_arm(robot, "left", grasps), name="left, for the first time")
    q = robot.configuration(START_CONFIGURATION)

    def make():
        environment = Environment.from_points(TABLE, VOLUME)
        _ = environment.clearance
        problem = Problem(robot, (arm,), q, body, VOLUME, environment)
        PlacementPlanner(problem, lambda _: 0.0, PlannerSettings(), np.random.default_rng(0))

    for allowed in (0, 5, 20):
        looks = Looks(allowed)
        with pytest.raises(StoppedError), stoppable(looks):
            make()
        assert looks.count == allowed + 1
