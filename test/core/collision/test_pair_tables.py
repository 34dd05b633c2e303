"""Cells of the joint tables against coal's distances all over them."""

import coal
import numpy as np
import pinocchio as pin
import pytest

from placement_planner_ros.core.collision.against_robot import tabled_apart
from placement_planner_ros.core.collision.arm import ArmCollision, CollisionSettings
from placement_planner_ros.core.collision.arrays import CELL_RAD, PAIR_ROWS
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.scenes.yumi import load_yumi, yumi_arm

MARGIN = 0.0002
"""Some of the YuMi's links pass each other at a millimetre."""

ELBOW = """
<robot name="elbow">
  <link name="base"><collision><origin xyz="0 0 0.05"/>
    <geometry><box size="0.2 0.2 0.1"/></geometry></collision>
    <collision><origin xyz="0.1 0 0.1"/>
    <geometry><sphere radius="0.06"/></geometry></collision></link>
  <link name="upper"/>
  <link name="fore"><collision><origin xyz="0.15 0 0"/>
    <geometry><cylinder radius="0.03" length="0.3"/></geometry></collision>
    <collision><origin xyz="0.3 0 0"/>
    <geometry><box size="0.05 0.1 0.04"/></geometry></collision></link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0.6 0 0.8"/>
    <origin xyz="0 0 0.2" rpy="0.1 0.2 0"/>
    <limit lower="-2.5" upper="2.5" velocity="1" effort="1"/></joint>
  <joint name="j2" type="revolute"><parent link="upper"/><child link="fore"/><axis xyz="0 1 0"/>
    <origin xyz="0.05 0 0.1"/><limit lower="{low}" upper="{high}" velocity="1" effort="1"/></joint>
</robot>
"""


def checker_for(robot, arm):
    nothing = ObstacleSet.from_points(
        np.zeros((0, 3)), GridSettings(), bounds=np.array([[-1.0] * 3, [1.0] * 3])
    )
    settings = CollisionSettings(self_margin=MARGIN, self_reserve=0.0)
    return ArmCollision(MovingArm(robot, arm, np.zeros(robot.model.nq)), None, nothing, settings)


def distance(robot, links, q):
    """Between the geometry of two links, by coal."""
    data, placements = robot.model.createData(), robot.geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.geometry, placements, q)
    at = [
        [
            (g.geometry, coal.Transform3s(T.rotation, T.translation))
            for g, T, owner in zip(
                robot.geometry.geometryObjects, placements.oMg, robot.geometry_links, strict=True
            )
            if owner == link
        ]
        for link in links
    ]
    return min(
        coal.distance(*a, *b, coal.DistanceRequest(), coal.DistanceResult())
        for a in at[0]
        for b in at[1]
    )


def tabled_pairs(checker):
    """Rows of pairs with a table by their links, with the first joint between them."""
    names, arrays = [body.name for body in checker._flat.bodies], checker._flat.arrays
    return {
        (names[a], names[b]): (row, first)
        for row, (a, b, _, first, *_) in enumerate(arrays.pairs.tolist())
        if arrays.pairs[row, PAIR_ROWS] > 0
    }


def apart(checker, row, first, at, *ranges):
    """What the table of that row says of joints from `first` on."""
    q, delta = np.zeros((2, len(checker._flat.arrays.prismatic)))
    q[first : first + 2] = at
    delta[first : first + 2] = ranges or 0.0
    return tabled_apart(checker._flat.arrays, row, q, delta)


@pytest.fixture(scope="module")
def elbow():
    robot = Robot.from_urdf(ELBOW.format(low=-2, high=2.5), srdf="<robot name='elbow'/>")
    return robot, robot.arm("arm", "fore")


@pytest.fixture(scope="module")
def yumi():
    robot = load_yumi()
    return robot, yumi_arm(robot, "right", ())


@pytest.mark.parametrize("which", ["elbow", "yumi"])
def test_links_are_apart_throughout_the_cells_that_say_so(request, which):
    robot, arm = request.getfixturevalue(which)
    checker = checker_for(robot, arm)
    rng = np.random.default_rng(1)
    for links, (row, first) in tabled_pairs(checker).items():
        joints = slice(first, first + 2)
        lower, upper = arm.lower[joints], arm.upper[joints]
        closest, certified = np.inf, 0
        for at in rng.uniform(lower, upper, (60, 2)):
            if not apart(checker, row, first, at):
                continue
            certified += 1
            corner = lower + np.floor((at - lower) / CELL_RAD) * CELL_RAD
            for share in (rng.random(2), rng.integers(0, 2, 2)):
                q = np.zeros(robot.model.nq)
                q[arm.q_index[joints]] = corner + share * CELL_RAD
                closest = min(closest, distance(robot, links, q))
        assert certified >= 6
        assert closest >= MARGIN - 1e-6


def test_a_range_is_apart_where_all_its_cells_are(elbow):
    checker, arm = checker_for(*elbow), elbow[1]
    ((row, first),) = tabled_pairs(checker).values()
    rng = np.random.default_rng(2)
    answers = []
    for at in rng.uniform(arm.lower, arm.upper, (200, 2)):
        wide = apart(checker, row, first, at, 2 * CELL_RAD, CELL_RAD)
        offsets = rng.uniform(-1.0, 1.0, (60, 2)) * [2 * CELL_RAD, CELL_RAD]
        inside = [apart(checker, row, first, at + offset) for offset in offsets]
        assert all(inside) or not wide
        answers.append((wide, all(inside)))
    assert {(True, True), (False, False)} <= set(answers)
    assert not apart(checker, row, first, arm.lower - 0.01)
    assert not apart(checker, row, first, arm.upper + 2 * CELL_RAD)
    assert not apart(checker, row, first, 0.0, 1e300, np.inf)


def test_links_past_a_joint_that_hardly_turns_have_no_table():
    robot = Robot.from_urdf(ELBOW.format(low=2.3, high=2.304), srdf="<robot name='elbow'/>")
    assert not tabled_pairs(checker_for(robot, robot.arm("arm", "fore")))


def test_a_wider_margin_than_the_tables_were_made_for_is_checked_without_them(yumi):
    links = ("yumi_link_5_r", "yumi_link_7_r")
    checker = checker_for(*yumi)
    at_zero = distance(yumi[0], links, np.zeros(yumi[0].model.nq))
    for margin in (at_zero - 1e-4, at_zero + 1e-4):
        wide = checker.with_pairs(
            lambda a, b: {a, b} == set(links), CollisionSettings(self_margin=margin)
        )
        assert wide.free(np.zeros(7)) == (margin < at_zero)
