"""Robot, motion, clouds, regions and the first view, without a browser."""

from dataclasses import replace
from itertools import pairwise
from unittest.mock import MagicMock

import numpy as np
import pinocchio as pin
import pytest

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.playback import JointCurve, Playback
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, TIP_FRAMES, load_yumi
from placement_planner_ros.share import share_path
from placement_planner_ros.view.robot import ShownRobot

TIP = TIP_FRAMES["left"]


def find(uri):
    return share_path("urdf", *uri.split("/urdf/")[1].split("/"))


@pytest.fixture(scope="module")
def robot():
    return ShownRobot(share_path("urdf", "yumi.urdf").read_text(), find)


# --- the robot


def test_every_link_stands_where_the_planner_has_it(robot):
    planned, rng = load_yumi(), np.random.default_rng(1)
    free = [name for name in planned.joint_names if name not in planned.mimics]
    positions = {name: float(rng.uniform(0.0, 0.02)) for name in free}
    q = planned.configuration(positions)
    poses = robot.link_poses(positions)
    for link in robot.shapes:
        assert poses[link].isApprox(planned.link_pose(q, link), 1e-9)
    assert set(robot.shapes) >= {TIP_FRAMES["left"], TIP_FRAMES["right"]}
    assert robot.lacking == []


def test_links_whose_meshes_are_missing_are_named_and_the_others_drawn():
    text = """<robot name="r"><link name="a"><visual><geometry><mesh filename="gone.stl"/>
      </geometry></visual><collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision>
      </link><link name="b"><collision><geometry><mesh filename="gone.stl"/></geometry></collision>
      </link>
      <joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint></robot>"""

    def nowhere(uri):
        raise FileNotFoundError(f"no {uri}")

    shown = ShownRobot(text, nowhere)
    assert list(shown.shapes) == ["a"]
    assert np.ptp(shown.shapes["a"][0], axis=0) == pytest.approx([0.1, 0.2, 0.3])
    assert shown.lacking == ["link b: no gone.stl"]
    with pytest.raises(RobotError):
        ShownRobot("<robot name='r'/>", nowhere)


# --- the motion


@pytest.fixture(scope="module")
def playback(robot):
    joints = tuple(f"yumi_joint_{n}_l" for n in (1, 2, 7, 3, 4, 5, 6))
    start = np.array([START_CONFIGURATION[j] for j in joints])
    carry = JointCurve(joints, np.array([0.0, 1.0, 2.0]), np.add(start, [[0.0], [0.1], [0.2]]))
    retreat = JointCurve(joints, np.array([0.0, 1.0]), np.add(start, [[0.2], [0.1]]))
    T = pin.SE3(np.eye(3), np.array([0.4, 0.1, 0.2]))
    opened = {"gripper_l_joint": 0.025}
    return Playback(
        robot.link_poses, TIP, dict(START_CONFIGURATION), carry, 1.5, opened, retreat, T
    )


def test_the_object_goes_with_the_hand_until_it_is_let_go(playback, robot):
    for time in (0.0, 0.7, 2.0):
        moment = playback.at(time)
        T_tip = robot.link_poses(moment.positions)[TIP]
        assert moment.T_world_object.isApprox(T_tip * playback.T_tip_object, 1e-9)
    assert playback.at(2.0).T_world_object.isApprox(playback.T_world_placed, 1e-9)
    assert playback.at(99.0).T_world_object.isApprox(playback.T_world_placed, 1e-9)
    assert not playback.at(0.0).T_world_object.isApprox(playback.T_world_placed, 1e-3)


def test_the_stages_follow_one_another_and_the_hand_is_open_at_the_end(playback):
    times = [0.0, 1.6, 2.3, 3.0]
    stages = ["transit", "approach", "release", "retreat"]
    assert [playback.at(time).stage for time in times] == stages
    assert playback.duration == pytest.approx(3.6)
    assert playback.at(3.6).positions["gripper_l_joint"] == 0.025
    assert playback.at(2.3).positions["gripper_l_joint"] == pytest.approx(
        (START_CONFIGURATION["gripper_l_joint"] + 0.025) / 2
    )
    assert playback.path()[0] == pytest.approx(playback.at(0.0).T_world_object.translation)
    assert playback.path()[-1] == pytest.approx([0.4, 0.1, 0.2])
    ended = replace(playback, retreat=None)
    assert ended.at(ended.duration).stage == "release"
    moments = [playback.at(float(time)) for time in np.linspace(0.0, playback.duration, 360)]
    for one, other in pairwise(moments):  # nothing jumps
        assert all(abs(value - other.positions[n]) < 0.02 for n, value in one.positions.items())
        gap = one.T_world_object.translation - other.T_world_object.translation
        assert np.abs(gap).max() < 0.02


def test_a_press_of_play_counts_for_what_is_shown_at_the_next_look():
    panel = pytest.importorskip("placement_planner_ros.view.panel", reason="viser is not installed")
    server = MagicMock()
    server.gui.add_slider.return_value.value = 0.0
    shown = panel.Panel(server, lambda *_: None)
    press = server.gui.add_button.return_value.on_click.call_args.args[0]
    press(None)
    shown.rewind(2.0)  # another motion comes meanwhile
    shown.advance(0.5, 2.0)
    assert (shown.playing, shown.time) == (True, 0.5)
    press(None)
    shown.advance(0.5, 2.0)
    assert (shown.playing, shown.time) == (False, 0.5)
