"""The tilt of a held object: bounds over whole edges against dense samples, and the way back."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.robots import SLIDING

from placement_planner_ros.core.carry.settings import CarrySettings, TiltLimit
from placement_planner_ros.core.carry.tilt import TiltConstraint
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm

R_TIP_OBJECT = pin.rpy.rpyToMatrix(0.4, -0.7, 1.1)
UP = np.array([0.3, -0.2, 0.9])


def chain_of(name):
    if name == "gantry":
        robot = Robot.from_urdf(SLIDING)
        return Chain.from_robot(robot, robot.arm("arm", "tip"), np.zeros(4))
    robot = load_yumi()
    arm = yumi_arm(robot, "left")
    return Chain.from_robot(robot, arm, robot.configuration(START_CONFIGURATION))


def made(name, degrees):
    chain = chain_of(name)
    return chain, TiltConstraint(chain, R_TIP_OBJECT, TiltLimit(UP, np.radians(degrees)))


def tilts(chain, Q):
    """By the product of rotations, degrees apart from nothing of the constraint's own."""
    up = chain.forward_batch(Q)[:, :3, :3] @ R_TIP_OBJECT @ (UP / np.linalg.norm(UP))
    return np.arccos(np.clip(up[:, 2], -1.0, 1.0))


def edges_within(chain, constraint, number, rng, longest=1.0):
    """Edges from configurations that planning may use."""
    lower, upper = np.maximum(chain.lower, -3.0), np.minimum(chain.upper, 3.0)
    made = 0
    while made < number:
        a = constraint.project(rng.uniform(lower, upper))
        if a is None:
            continue
        way = rng.normal(size=chain.dof)
        b = a + rng.uniform(0.01, longest) * way / np.linalg.norm(way)
        made += 1
        yield a, b


@pytest.mark.parametrize("name", ["yumi", "gantry"])
def test_no_certified_edge_leans_more_wherever_it_strays_to(name):
    rng = np.random.default_rng(0)
    certified = needless = possible = 0
    for degrees in (5.0, 15.0, 60.0, 120.0):
        chain, constraint = made(name, degrees)
        most = constraint.limit.most
        for a, b in edges_within(chain, constraint, 60, rng):
            deviation = rng.uniform(0.0, 0.02, chain.dof) * rng.integers(2)
            s = np.linspace(0.0, 1.0, 200)[:, None]
            line = a + s * (b - a)
            aside = line + deviation * rng.choice([-1.0, 1.0], line.shape)
            leant = max(tilts(chain, line).max(), tilts(chain, aside).max())
            keeps = constraint.keeps_timed(a, b, deviation)
            if keeps:
                certified += 1
                assert leant <= most + 1e-9
            elif leant < most - 0.02 - 1.5 * deviation.sum():
                needless += 1
            possible += leant < most - 0.02 - 1.5 * deviation.sum()
    assert certified > 50
    assert needless == 0, f"of {possible} that stay well within"


def test_a_limit_needs_a_direction():
    assert CarrySettings().tilt_limit(()) is None
    assert CarrySettings().tilt_limit((0.0, 0.0, 1.0)) is None
    limit = CarrySettings(max_tilt=0.2).tilt_limit((0.0, 0.0, 2.0))
    assert limit.tilt(pin.rpy.rpyToMatrix(0.1, 0.0, 3.0)) == pytest.approx(0.1)
    with pytest.raises(ParameterError, match=r"`max_tilt`.*needs `up`"):
        CarrySettings(max_tilt=0.2).tilt_limit(())
    for bad in (-0.1, 3.2, np.nan):
        with pytest.raises(ParameterError, match="max_tilt"):
            CarrySettings(max_tilt=bad)
    with pytest.raises(ParameterError, match="max_acceleration"):
        CarrySettings(max_acceleration=-1.0)
