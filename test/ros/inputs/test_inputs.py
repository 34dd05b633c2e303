"""Clouds and joint states by their stamps, whatever the clock does."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from helpers.home import HOME
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.ros.inputs import inputs
from placement_planner_ros.ros.inputs.frames import CloudFrameError
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.inputs.resources import Files
from placement_planner_ros.ros.inputs.robot_input import RobotInput
from placement_planner_ros.ros.parameters.table import (
    arm_specs,
    arms_spec,
    fixed_specs,
    sensor_pose_spec,
)
from placement_planner_ros.ros.parameters.values import ParameterSet

SPECS = {s.name: s for s in [*fixed_specs(), arms_spec(["left"]), *arm_specs("left", yumi=True)]}
LINK, JOINT = "gripper_l_base", "yumi_joint_1_l"
POINT = np.array([0.0, 0.0, 0.2])
FILES = Files([], [])


def parameter_set(**values):
    return ParameterSet(SPECS, {name.replace("__", "."): v for name, v in values.items()})


def stamp(seconds):
    return Time(sec=int(np.floor(seconds)), nanosec=round((seconds % 1.0) * 1e9))


class World:
    """Inputs, with a clock that shows what a test wants."""

    def __init__(self, robot, **parameters):
        self.clock = SimpleNamespace(seconds=0.0, now=self.now)
        self.parameters = parameter_set(**parameters)
        nowhere = SimpleNamespace(pose=lambda *_, **__: None)
        self.inputs = Inputs(self.parameters, ["points"], nowhere, self.clock)
        self.inputs.robot = robot

    def now(self):
        return SimpleNamespace(nanoseconds=round(self.clock.seconds * 1e9))

    def joints(self, at, **changes):
        values = {**HOME, **changes}
        self.inputs.take_joint_state(
            JointState(
                header=Header(stamp=stamp(at)),
                name=list(values),
                position=[float(v) for v in values.values()],
            )
        )

    def sweep(self, begin, end, speed=0.0, step=0.02):
        """Joint states of a joint that turns with that speed from 0 at `begin`."""
        for at in np.arange(begin, end, step):
            self.joints(at, **{JOINT: speed * (at - begin)})

    def cloud(self, at, points=POINT, frame=LINK):
        message = message_from_points(
            np.reshape(points, (-1, 3)), Header(frame_id=frame, stamp=stamp(at))
        )
        self.inputs.take_cloud("points", message, self.parameters)

    def seen(self):
        return self.inputs.clouds.latest()["points"].points

    def point_at(self, value):
        """Where `POINT` of the link is with the joint at that value."""
        robot = self.inputs.robot.robot
        return robot.link_pose(robot.configuration({**HOME, JOINT: value}), LINK).act(POINT)


@pytest.fixture(scope="module")
def robot():
    made = RobotInput(parameter_set(), FILES)
    made.wait()
    yield made
    made.reading.close()


@pytest.mark.parametrize("mode", ["latest", "merge"])
@pytest.mark.parametrize("at", [0.0, 90.0, 100.5, 103.0])
def test_a_cloud_counts_where_its_link_has_rested_since(robot, at, mode):
    world = World(robot, cloud__mode=mode)
    world.sweep(100.0, 101.0, speed=0.5)
    with pytest.raises(CloudFrameError, match=JOINT):
        world.cloud(at)
    # The other arm may move as it likes.
    world = World(robot)
    for time_ in np.arange(100.0, 101.0, 0.02):
        world.joints(time_, yumi_joint_1_r=time_ - 100.0)
    world.cloud(at)
    np.testing.assert_allclose(world.seen(), [world.point_at(HOME[JOINT])], atol=1e-6)


def test_only_the_joints_that_lead_to_the_link_need_be_known(robot):
    world = World(robot)
    with pytest.raises(CloudFrameError, match="missing"):
        world.cloud(100.0)
    mine = {name: value for name, value in HOME.items() if name.endswith("_l")}
    message = JointState(name=list(mine), position=[float(v) for v in mine.values()])
    world.inputs.take_joint_state(message)
    world.cloud(100.0)
    np.testing.assert_allclose(world.seen(), [world.point_at(HOME[JOINT])], atol=1e-6)


def test_what_is_too_far_away_is_no_point_and_no_sensor(robot):
    world = World(robot, cloud__mode="merge")
    world.cloud(0.0, [[1e30, 0.0, 0.0], [0.0, -1e7, 0.0], [1.0, 2.0, 3.0]], frame="yumi_body")
    np.testing.assert_array_equal(world.seen(), [[1.0, 2.0, 3.0]])
    specs = SPECS | {"sensor_poses.eye": sensor_pose_spec("eye")}
    far = {"sensor_poses.eye": [0.0, 1e300, 0.0, 0.0, 0.0, 0.0, 1.0]}
    with pytest.raises(ParameterError, match="eye"):
        ParameterSet(specs, far)


@pytest.mark.parametrize("mode", ["latest", "merge"])
def test_a_cloud_goes_where_its_sensor_is_said_to_be_since_but_not_from_among_others(robot, mode):
    world = World(robot)
    specs = SPECS | {"sensor_poses.eye": sensor_pose_spec("eye")}

    def said_at(x):
        pose = [x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
        values = {"cloud.mode": mode, "sensor_frames": ["eye"], "sensor_poses.eye": pose}
        return ParameterSet(specs, values)

    world.parameters = said_at(0.1)
    world.cloud(0.0, frame="eye")
    first = world.inputs.clouds.latest()["points"].points
    world.inputs.retry_clouds(said_at(0.1))
    assert world.inputs.clouds.latest()["points"].points is first
    for x in (0.4, 0.3):
        world.inputs.retry_clouds(said_at(x))
        there = x if mode == "latest" else 0.1
        np.testing.assert_allclose(world.seen(), [POINT + np.array([there, 0.0, 0.0])], atol=1e-6)
    assert len(world.inputs.clouds.merged) == (mode == "merge")


def test_where_a_topic_has_delivered_a_cloud_on_the_move_is_left_out_without_a_word(robot):
    world = World(robot, cloud__mode="merge")
    world.sweep(110.0, 111.0)
    world.cloud(110.5)
    before = world.inputs.clouds.latest()["points"].points
    world.sweep(120.0, 121.0, speed=0.03)
    world.cloud(120.5)
    assert world.inputs.clouds.latest()["points"].points is before
    (newest, merged) = world.inputs.clouds.parts("merge")
    np.testing.assert_array_equal(newest.points, merged.points)
    # The frame of a sensor that stands beside the robot does not move.
    world.cloud(120.5, frame="yumi_body")
    assert len(world.inputs.clouds.parts("merge")[1].points) == 2


@pytest.mark.parametrize("mode", ["latest", "merge"])
def test_a_stamp_from_before_the_last_motion_tells_no_place(robot, mode):
    world = World(robot, cloud__mode=mode)
    world.sweep(100.0, 101.0, speed=0.5)
    for at in np.arange(101.0, 110.0, 0.02):
        world.joints(at, **{JOINT: 0.5})
    with pytest.raises(CloudFrameError):
        world.cloud(99.0)
    world.cloud(103.0)
    np.testing.assert_allclose(world.seen(), [world.point_at(0.5)], atol=1e-6)


def age(world):
    return world.inputs.clouds.ages(time.monotonic())["points"]


def test_ages_survive_every_clock(robot):
    world = World(robot)
    # Simulated time has not begun, or the camera does without it.
    for at in (0.0, 5.0, 1.7e9):
        world.cloud(at, frame="yumi_body")
        assert 0.0 <= age(world) < 5.0
    # It begins, jumps forwards and backwards; that makes what has arrived no older.
    for now in (5.0, 1e9, 3.0):
        world.clock.seconds = now
        assert 0.0 <= age(world) < 5.0
    world.cloud(1e6, frame="yumi_body")
    assert 0.0 <= age(world) < 5.0
    # What arrives with a stamp from long ago is old.
    world.clock.seconds = 1000.0
    world.cloud(100.0, frame="yumi_body")
    assert 900.0 <= age(world) < 905.0


@pytest.mark.parametrize("stamped", [True, False])
@pytest.mark.parametrize("to", [0.5, 99.0, 1e6])
def test_joints_and_their_clouds_survive_a_clock_that_jumps(robot, stamped, to, monkeypatch):
    world = World(robot)
    steady = SimpleNamespace(seconds=0.0, monotonic=lambda: steady.seconds)
    monkeypatch.setattr(inputs, "time", steady)

    def play(begin, value):
        for at in np.arange(begin, begin + 1.0, 0.02):
            world.clock.seconds = at
            world.joints(at if stamped else 0.0, **{JOINT: value})
            steady.seconds += 0.02

    play(100.0, 0.0)
    play(to, 0.3)
    assert world.inputs.joints.positions()[JOINT] == 0.3
    assert world.inputs.joints.age(steady.seconds) < 0.05
    world.cloud(to + 0.95)
    np.testing.assert_allclose(world.seen(), [world.point_at(0.3)], atol=1e-6)
