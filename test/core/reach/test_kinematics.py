"""Chains against pinocchio, on the YuMi, the Panda and an arm with a sliding joint."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.robots import SLIDING
from helpers.shared import SHARED

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.reach.reach_bound import ReachBound
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm


def panda() -> Robot:
    urdf = SHARED / "data/robots/panda_description/urdf/panda_collision.urdf"
    if not urdf.is_file():
        pytest.skip("needs the shared Panda")
    return Robot.from_urdf(urdf.read_text(encoding="utf-8"))


def case(name: str) -> tuple[Robot, Arm, np.ndarray]:
    if name == "panda":
        robot = panda()
        return robot, robot.arm("arm", "panda_hand"), np.zeros(robot.model.nq)
    if name == "gantry":
        robot = Robot.from_urdf(SLIDING)
        return robot, robot.arm("arm", "tip"), np.zeros(4)
    if name == "part":  # some joints on the way stand still
        robot = Robot.from_urdf(SLIDING)
        return robot, robot.arm("arm", "tip", ["turn", "roll"]), np.array([0.3, 0, 0.2, 0])
    robot = load_yumi()
    return robot, yumi_arm(robot, name), robot.configuration(START_CONFIGURATION)


@pytest.mark.parametrize("name", ["left", "right", "panda", "gantry", "part"])
def test_agrees_with_pinocchio(name):
    robot, arm, q_rest = case(name)
    chain = Chain.from_robot(robot, arm, q_rest)
    rng = np.random.default_rng(0)
    T_tip_object = pin.SE3(pin.rpy.rpyToMatrix(0.3, -1.0, 2.0), np.array([0.1, -0.05, 0.2]))
    Q = rng.uniform(arm.lower, arm.upper, (20, arm.dof))
    tips = chain.forward_batch(Q)
    model = robot.model.copy()
    tip = robot.frame_id(arm.tip_frame)
    carried = model.frames[tip].placement * T_tip_object
    object_id = model.addFrame(
        pin.Frame("object", model.frames[tip].parentJoint, tip, carried, pin.FrameType.OP_FRAME)
    )
    data = model.createData()
    for k, x in enumerate(Q):
        q = q_rest.copy()
        q[arm.q_index] = x
        pin.framesForwardKinematics(model, data, q)
        J = pin.computeFrameJacobian(model, data, q, object_id, pin.LOCAL_WORLD_ALIGNED)
        assert np.abs(tips[k] - data.oMf[tip].homogeneous).max() < 1e-12
        jacobian = chain.jacobian(x, T_tip_object.homogeneous)
        assert np.abs(jacobian - J[:, arm.q_index]).max() < 1e-12


@pytest.mark.parametrize("name", ["left", "right", "panda", "gantry", "part"])
def test_no_configuration_takes_the_wrist_further_than_the_reach_bound(name):
    """By pinocchio, at random configurations and uphill from the furthest of them."""
    robot, arm, q_rest = case(name)
    bound = ReachBound.of(Chain.from_robot(robot, arm, q_rest))
    data, tip = robot.model.createData(), robot.frame_id(arm.tip_frame)
    q = q_rest.copy()

    def distance(x):
        q[arm.q_index] = x
        pin.forwardKinematics(robot.model, data, q)
        T = pin.updateFramePlacement(robot.model, data, tip)
        return float(np.linalg.norm(T.act(bound.wrist) - bound.shoulder))

    rng = np.random.default_rng(2)
    lower, upper = np.maximum(arm.lower, -10.0), np.minimum(arm.upper, 10.0)
    Q = rng.uniform(lower, upper, (2000, arm.dof))
    furthest = max(Q, key=distance)
    for step in np.geomspace(1.0, 0.001, 600):
        nearby = np.clip(furthest + step * rng.normal(size=arm.dof), lower, upper)
        furthest = max(furthest, nearby, key=distance)
    assert distance(furthest) <= bound.length
    assert distance(furthest) >= 0.7 * bound.length, "the bound is idle"


def test_rest_of_wrong_length_is_refused():
    robot, arm, _ = case("gantry")
    with pytest.raises(RobotError, match="q_rest"):
        Chain.from_robot(robot, arm, np.zeros(3))


def test_freedom_counts_the_directions_that_joints_move_the_tip_in():
    robot = Robot.from_urdf(SLIDING)
    assert Chain.from_robot(robot, robot.arm("arm", "tip"), np.zeros(4)).freedom == 4
    robot = load_yumi()
    q = robot.configuration(START_CONFIGURATION)
    assert Chain.from_robot(robot, yumi_arm(robot, "left"), q).freedom == 6
    # `turn` slides as `along` does
    in_line = SLIDING.replace('type="revolute"', 'type="prismatic"', 1)
    in_line = in_line.replace('"0.6 0 -0.8"', '"1 0 0"')
    robot = Robot.from_urdf(in_line)
    assert Chain.from_robot(robot, robot.arm("arm", "tip"), np.zeros(4)).freedom == 3
