"""What a pose of the hand decides, against distances known in closed form."""

import numpy as np
import pinocchio as pin
import pytest

from placement_planner_ros.core.collision.arm import ArmCollision, CollisionSettings
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet

BOUNDS = np.array([[-1.0, -1.0, -1.0], [1.5, 1.0, 1.0]])

WRIST = """
<robot name="wrist">
  <link name="base"><collision><origin xyz="1 0 0"/>
    <geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <link name="fore">
    <collision><origin xyz="-0.1 0 0.3"/>
    <geometry><box size="0.2 0.06 0.02"/></geometry></collision>
    <collision><origin xyz="0 0 0.3"/>
    <geometry><sphere radius="0.015"/></geometry></collision></link>
  <link name="ball"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="fore"/><axis xyz="0 1 0"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.3 -0.2 0.5"/>
    <limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="j2" type="revolute"><parent link="fore"/><child link="ball"/><axis xyz="0 0 1"/>
    <origin xyz="0.05 0.02 0.3"/><limit lower="-1.5" upper="2" velocity="1" effort="1"/></joint>
</robot>
"""


def checker_for(points=None, body=None, **settings):
    robot = Robot.from_urdf(WRIST, srdf="<robot name='wrist'/>")
    grasp = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.06]))
    arm = robot.arm("arm", "ball", grasps=[grasp], touch_links=["ball", "fore"])
    points = np.zeros((0, 3)) if points is None else points
    obstacles = ObstacleSet.from_points(points, GridSettings(cell_size=0.01), bounds=BOUNDS)
    load = None if body is None else AttachedObject(body)
    moving = MovingArm(robot, arm, np.zeros(2))
    return ArmCollision(moving, load, obstacles, CollisionSettings(**settings)), obstacles


def at(x, yaw=0.0):
    """The tip at (x, 0, 0), turned somehow; the ball does not care."""
    R = pin.utils.rotate("z", yaw) @ pin.utils.rotate("x", 0.7)
    return np.ascontiguousarray(pin.SE3(R, np.array([x, 0.0, 0.0])).homogeneous)


@pytest.mark.parametrize("reserve", [0.0, 0.0001, 0.001])
def test_the_hand_collides_from_its_margin_on_less_what_it_may_be_off_by(reserve):
    y, z = (a.ravel() for a in np.meshgrid(*[np.arange(-0.2, 0.2, 0.005)] * 2))
    wall = np.column_stack([np.full(len(y), -0.5), y, z])
    settings = {"self_margin": 0.001, "self_reserve": 0.0002}
    slack = 0.0004
    walled, obstacles = checker_for(points=wall, **settings)
    bare, _ = checker_for(**settings)
    face = obstacles.upper[:, 0].max()
    kept = 0.02 - slack + 0.003 + reserve
    for off, collides in ((-1e-5, True), (1e-5, False)):
        T = at(face + kept + off, np.pi)  # the link before it on the far side
        assert walled.hand_collides(T, slack, reserve) == collides
    kept = 0.02 - slack + 0.001 + min(reserve, 0.0002)
    for off, collides in ((-1e-5, True), (1e-5, False)):
        for checker in (walled, bare):
            assert checker.hand_collides(at(0.95 - kept - off), slack, reserve) == collides
