"""A point of a held object on timed curves: against pinocchio, and against dense samples."""

import numpy as np
import pytest
from helpers.robots import SLIDING

from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.timing.carried_point import CarriedPoint
from placement_planner_ros.core.timing.quintic import positions_at
from placement_planner_ros.core.timing.timing import parameterize_path
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm

POINT = np.array([0.05, -0.08, 0.15])


def always(a, b, deviation):
    return True


@pytest.fixture(scope="module", params=["yumi", "sliding"])
def arm(request):
    if request.param == "sliding":
        robot = Robot.from_urdf(SLIDING)
        made, q = robot.arm("arm", "tip"), np.zeros(4)
    else:
        robot = load_yumi()
        made, q = yumi_arm(robot, "left"), robot.configuration(START_CONFIGURATION)
    return robot, made, q, Chain.from_robot(robot, made, q)


def timed(arm, limit, seed=0):
    _, made, _, chain = arm
    rng = np.random.default_rng(seed)
    start = 0.5 * (made.lower + made.upper)
    path = start + np.cumsum(rng.uniform(-0.25, 0.25, (5, made.dof)), axis=0)
    path = np.clip(path, made.lower, made.upper)
    carried = CarriedPoint(chain, POINT, limit) if limit else None
    limits = np.array([np.full(made.dof, 2.0), np.full(made.dof, 5.0)])
    return path, parameterize_path(path, made.joints, limits, always, carried=carried)


def reached(arm, trajectory, per_second=4000):
    """|p''| densely along a trajectory, from differences of the places of the point."""
    chain = arm[3]
    t = np.linspace(0.0, trajectory.duration, int(per_second * trajectory.duration))
    T = chain.forward_batch(positions_at(trajectory, t))
    p = T[:, :3, :3] @ POINT + T[:, :3, 3]
    return np.linalg.norm(p[2:] - 2.0 * p[1:-1] + p[:-2], axis=1) / (t[1] - t[0]) ** 2


@pytest.mark.parametrize("limit", [0.3, 1.5])
def test_timing_keeps_the_limit_and_uses_it(arm, limit):
    path, trajectory = timed(arm, limit)
    _, free = timed(arm, None)
    assert trajectory is not None
    assert free is not None
    accelerations = reached(arm, trajectory)
    assert accelerations.max() <= limit * (1.0 + 1e-4)
    assert accelerations.max() >= 0.8 * min(limit, reached(arm, free).max())
    assert trajectory.duration >= free.duration * (1.0 - 1e-6)
    np.testing.assert_array_equal(trajectory.positions[[0, -1]], path[[0, -1]])
    np.testing.assert_array_equal(trajectory.velocities[[0, -1]], 0.0)
    np.testing.assert_array_equal(trajectory.accelerations[[0, -1]], 0.0)
