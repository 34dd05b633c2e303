"""Frames that only tf2 knows. The wheels do not have it, so a buffer of our own stands for it."""

import importlib.machinery
import sys
import types
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Transform, TransformStamped
from helpers.fakes import TABLE, placement
from rclpy.duration import Duration

from placement_planner_ros.ros.inputs.transforms import SET_BACK, Transforms

ROOT = "yumi_body"


class TransformException(Exception):  # noqa: N818, as tf2_ros calls it
    pass


class Buffer:
    """Knows what `known` says, from the stamps that `since` says on."""

    made = None

    def __init__(self):
        type(self).made = self
        self.known = {}
        self.since = 0
        self.asked = []
        self.cleared = 0

    def lookup_transform(self, target, source, time, timeout=None):
        self.asked.append((target, source, time.nanoseconds, timeout))
        late = time.nanoseconds != 0 and time.nanoseconds < self.since
        if (target, source) not in self.known or late:
            raise TransformException("unknown")
        T = self.known[target, source]
        x, y, z, *quaternion = (float(v) for v in pin.SE3ToXYZQUAT(T))
        made = Transform()
        made.translation.x, made.translation.y, made.translation.z = x, y, z
        r = made.rotation
        r.x, r.y, r.z, r.w = quaternion
        return TransformStamped(transform=made)

    def clear(self):
        self.cleared += 1


@pytest.fixture
def tf2(monkeypatch):
    module = types.ModuleType("tf2_ros")
    module.__spec__ = importlib.machinery.ModuleSpec("tf2_ros", None)
    module.Buffer, module.TransformException = Buffer, TransformException
    module.TransformListener = lambda buffer, node, **_: SimpleNamespace(buffer=buffer, node=node)
    monkeypatch.setitem(sys.modules, "tf2_ros", module)


def turned(angle, x):
    return pin.SE3(pin.utils.rotate("z", angle), np.array([x, 0.5, 0.0]))


def test_the_planning_frame_is_looked_up_at_each_start(tf2, bench):
    b = bench(planning_frame="map", **{"target_volume": [0.0, 0.0, -0.1, 3.0, 1.0, 0.2]})
    buffer = Buffer.made
    b.wait(lambda: b.status()["robot"] == "bad")

    def feed(frame, stamp=None):
        updates = b.node._inputs.clouds.updates

        def publish():
            b.cloud(TABLE, frame=frame, stamp=stamp)
            b.joint_state()

        b.wait(lambda: b.node._inputs.clouds.updates > updates, again=publish)

    def start():
        b.joint_state()
        return b.call("start")

    def snapshot():
        b.wait(lambda: start().success)
        b.wait(lambda: b.call("stop").code == "NOT_RUNNING")
        return b.snapshots[-1]

    b.cloud(TABLE, frame=ROOT)
    b.wait(lambda: b.node._inputs._waiting)
    b.joint_state()
    b.wait(lambda: b.node._inputs.joints.positions())
    answer = b.call("start")
    assert "planning_frame" in answer.text
    assert "tf2 does not know" in answer.text
    # Now it is known, also for the cloud that has waited.
    robots = []
    for T in (turned(0.3, 1.0), turned(0.3, 1.0), turned(-0.7, 2.0)):
        buffer.known["map", ROOT] = T
        seen = snapshot()
        robots.append(seen.robot)
        assert seen.frame == "map"
        pose = seen.robot.link_pose(seen.q_start, ROOT)
        np.testing.assert_allclose(pose.homogeneous, T.homogeneous, atol=1e-9)
        if len(robots) == 1:
            expected = np.array([T.act(p) for p in TABLE])
            np.testing.assert_allclose(np.vstack(seen.clouds), expected, atol=1e-6)
    # What was remembered of the robot stays good where it has not moved.
    assert robots[0] is robots[1]
    assert b.status()["robot"] == "ready"
    # A cloud of a link is where the robot was when it was taken, not where it was at start.
    buffer.known["map", ROOT] = moved = turned(0.1, 0.7)
    feed(ROOT, Time(sec=50))
    assert ("map", ROOT, 50 * 10**9) in [asked[:3] for asked in buffer.asked]
    expected = np.array([moved.act(p) for p in TABLE])
    np.testing.assert_allclose(b.node._inputs.clouds.latest()["points"].points, expected, atol=1e-6)
    buffer.known.clear()
    b.joint_state()
    assert "BAD_ROBOT" in b.call("start").text
    b.wait(lambda: b.status()["robot"] == "bad")


def test_a_base_that_moves_ends_the_run_and_its_placement_holds_no_more(tf2, bench):
    volume = [0.0, 0.0, -0.1, 3.0, 1.0, 0.2]
    b = bench(planning_frame="map", time_limit=0.0, target_volume=volume)
    buffer = Buffer.made
    at = pin.SE3(np.eye(3), np.array([1.0, 0.5, 0.0]))
    buffer.known["map", ROOT] = at

    def told(state, valid, words=""):
        b.wait(
            lambda: (
                b.status()["state"] == state
                and b.status()["best_valid"] == valid
                and words in b.status()["best_invalid_reason"]
            ),
            again=b.joint_state,
        )

    b.cloud(TABLE, frame="map")

    def begun():
        b.cloud(TABLE, frame="map")
        b.joint_state()
        return b.call("start").success

    b.wait(begun)
    b.wait(lambda: b.planners and b.planners[-1].searching.is_set())
    b.planners[-1].offers.append(placement(0.1))
    b.wait(lambda: b.manifests()[-1]["solution"] == "1")
    # By less than start_tolerance, in either way, and a look at a start that is refused.
    buffer.known["map", ROOT] = at * pin.SE3(pin.utils.rotate("z", 0.01), np.array([0.01, 0, 0]))
    assert b.call("start").code == "ALREADY_RUNNING"
    b.node._inputs.robot.look_up()
    told("searching", "true")
    for way in (
        pin.SE3(np.eye(3), np.array([0.0, 0.03, 0.0])),
        pin.SE3(pin.utils.rotate("z", 0.03), np.zeros(3)),
    ):
        buffer.known["map", ROOT] = at * way
        told("robot_moved", "false", "the robot's base has moved in 'map'")
        buffer.known["map", ROOT] = at
        told("robot_moved", "true")
    del buffer.known["map", ROOT]
    told("robot_moved", "false", "tf2 does not know any more where 'yumi_body' is in 'map'")


def transforms(buffer_of=Buffer):
    """Transforms of a node that has a clock only, and what it does when the clock jumps."""
    jumps = []
    clock = SimpleNamespace(
        create_jump_callback=lambda threshold, post_callback: jumps.append(
            (threshold, post_callback)
        )
    )
    made = Transforms(SimpleNamespace(get_clock=lambda: clock))
    return made, buffer_of.made, jumps


def test_a_transform_is_asked_for_at_the_stamp_and_waited_for_only_where_told(tf2):
    made, buffer, _ = transforms()
    buffer.known["a", "b"] = T = turned(0.2, 3.0)
    found = made.pose("a", "b", Time(sec=7), wait=True)
    np.testing.assert_allclose(found.homogeneous, T.homogeneous, atol=1e-12)
    assert buffer.asked[-1][2] == 7 * 10**9
    assert buffer.asked[-1][3] > Duration()
    assert made.pose("a", "c") is None
    assert buffer.asked[-1][2:] == (0, Duration())


@pytest.mark.parametrize("bad", [0.0, float("nan"), float("inf")])
def test_a_transform_that_is_none_is_not_known(tf2, monkeypatch, bad):
    made, buffer, _ = transforms()
    buffer.known["a", "b"] = pin.SE3.Identity()
    found = buffer.lookup_transform("a", "b", SimpleNamespace(nanoseconds=0))
    r = found.transform.rotation
    r.x = r.y = r.z = r.w = bad
    monkeypatch.setattr(Buffer, "lookup_transform", lambda *_, **__: found)
    assert made.pose("a", "b") is None


def test_a_clock_that_is_set_back_clears_the_buffer(tf2):
    _, buffer, ((threshold, after),) = transforms()
    assert threshold.min_backward == SET_BACK
    assert threshold.on_clock_change
    after(None)
    assert buffer.cleared == 1


def test_without_tf2_nothing_is_known(monkeypatch):
    monkeypatch.setitem(sys.modules, "tf2_ros", None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert Transforms(None).pose("a", "b") is None
