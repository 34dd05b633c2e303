"""Trajectories followed as a controller does, a hand that opens, and what bodies make of it."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

pytest.importorskip("mujoco")

from placement_planner_ros.core.types import Trajectory
from placement_planner_ros.demo.physics.carrying_out import (
    CARRY,
    DOWN,
    DRAW_BACK,
    LET_GO,
    STAND,
    CarryingOut,
)
from placement_planner_ros.demo.physics.model import SimulatedThing
from placement_planner_ros.demo.physics.outcome import CarryOutcome, leaning
from placement_planner_ros.scenes.primitives import box
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm

GREY = (0.5, 0.5, 0.5)
JOINT, TURN = 2, 0.15
"""Which joint carries by how many radians."""
HALF = 0.015
"""m, of the cube that is put down."""
DOWNWARDS = 0.004
"""m that the cube is above the post as the hand opens."""


def turned(arm, q, joint, by):
    """From q, with one joint turned, at rest at both ends."""
    start = q[arm.q_index]
    ends = np.stack([start, start + by * (np.arange(arm.dof) == joint)])
    return Trajectory(arm.joints, np.array([0.0, 0.4]), ends, 0.0 * ends, 0.0 * ends)


@pytest.fixture(scope="module")
def carrying():
    """A cube, fixed before the fingers, that one joint of an arm lets down onto a post."""
    robot = load_yumi()
    arm = yumi_arm(robot, "left")
    q = robot.configuration(START_CONFIGURATION)
    there = turned(arm, q, JOINT, TURN)
    reached = robot.with_positions(q, dict(zip(arm.joints, there.positions[-1], strict=True)))
    T_tip = robot.link_pose(reached, arm.tip_frame)
    upright = pin.SE3(np.eye(3), T_tip.act(np.array([0.0, 0.0, 0.20])))
    corners = box("cube", [-HALF] * 3, [HALF] * 3, GREY).vertices
    return CarryingOut(
        robot,
        arm,
        T_tip.inverse() * upright,
        q,
        [post(upright.translation)],
        SimulatedThing("cube", (corners,), np.zeros(3), upright),
        [],
        there,
        0.2,
        turned(arm, reached, JOINT, -0.5 * TURN),
    )


def post(below, gap=DOWNWARDS):
    x, y, z = below
    top = z - HALF - gap
    return box("post", (x - 0.02, y - 0.02, top - 0.02), (x + 0.02, y + 0.02, top), GREY)


@pytest.fixture(scope="module")
def looks(carrying):
    return list(carrying.looks())


def planned(carrying):
    return carrying.thing.T_world_thing


def test_each_stage_follows_the_one_before(carrying, looks):
    stages = list(dict.fromkeys(look.stage for look in looks))
    assert stages == [CARRY, DOWN, LET_GO, DRAW_BACK, STAND]
    assert looks[-1].time == pytest.approx(carrying.duration)
    assert min(look.time for look in looks if look.stage == DOWN) == pytest.approx(0.2, abs=0.02)


def test_the_drives_follow_the_quintic_between_two_points(carrying, looks):
    index = carrying.arm.q_index[JOINT]
    for look in looks:
        if look.time <= 0.4:
            s = look.time / 0.4  # at rest at both ends: 10 s³ - 15 s⁴ + 6 s⁵
            asked = carrying.q_start[index] + TURN * (10 * s**3 - 15 * s**4 + 6 * s**5)
            assert look.q[index] == pytest.approx(asked, abs=1e-3)


def test_the_thing_goes_with_the_hand_until_that_opens_and_then_falls(carrying, looks):
    assert carrying.struck == set()
    outcome = CarryOutcome.of(
        np.zeros(3), planned(carrying), carrying.arrived, looks[-1].places["cube"], set()
    )
    assert outcome.reached
    assert outcome.off < 3e-4
    assert outcome.moved == pytest.approx(DOWNWARDS, abs=5e-4)
    assert outcome.tilted < np.deg2rad(1.0)
    fingers = [look.q[carrying.robot.index("gripper_l_joint")] for look in looks]
    assert fingers[0] < 0.021
    assert fingers[-1] == pytest.approx(0.025, abs=1e-4)


def test_what_is_struck_on_the_way_is_named(carrying):
    way = 0.5 * (
        planned(carrying).translation
        + (carrying.robot.link_pose(carrying.q_start, carrying.arm.tip_frame)).act(
            carrying.T_tip_thing.translation
        )
    )
    low, high = way - 0.008, way + 0.008
    hit = replace(carrying, scene=[*carrying.scene, box("wire", low, high, GREY)])
    last = next(look for look in hit.looks() if look.stage == LET_GO)
    assert {frozenset(pair) for pair in hit.struck} >= {frozenset({"cube", "wire"})}
    outcome = CarryOutcome.of(
        np.zeros(3), planned(hit), hit.arrived, last.places["cube"], hit.struck
    )
    assert not outcome.reached


def test_leaning_is_the_angle_of_what_was_up():
    before = pin.SE3(pin.exp3(np.array([0.3, -0.2, 1.0])), np.zeros(3))
    for angle in (0.0, 1e-4, 0.1, 2.0):
        about_x = pin.SE3(pin.exp3(np.array([angle, 0.0, 0.0])), np.ones(3))
        yaw = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.7])), np.zeros(3))
        assert leaning(before, yaw * about_x * before) == pytest.approx(angle, abs=1e-12)
