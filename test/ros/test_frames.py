"""Frames that only tf2 knows. The wheels do not have it, so a buffer of our own stands for it."""

import importlib.machinery
import sys
import types
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pinocchio as pin
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Transform, TransformStamped
from helpers.fakes import TABLE
from rclpy.duration import Duration

from placement_planner_ros.ros.inputs.transforms import Transforms

ROOT = "yumi_body"


class TransformException(Exception):  # noqa: N818, as tf2_ros calls it
    pass


class Buffer:
    """Knows what `known` says."""

    made = None

    def __init__(self):
        type(self).made = self
        self.known = {}
        self.asked = []

    def lookup_transform(self, target, source, time, timeout=None):
        self.asked.append((target, source, time.nanoseconds, timeout))
        if (target, source) not in self.known:
            raise TransformException("unknown")
        T = self.known[target, source]
        x, y, z, *quaternion = (float(v) for v in pin.SE3ToXYZQUAT(T))
        made = Transform()
        made.translation.x, made.translation.y, made.translation.z = x, y, z
        r = made.rotation
        r.x, r.y, r.z, r.w = quaternion
        return TransformStamped(transform=made)


@pytest.fixture
def tf2(monkeypatch):
    module = types.ModuleType("tf2_ros")
    module.__spec__ = importlib.machinery.ModuleSpec("tf2_ros", None)
    module.Buffer, module.TransformException = Buffer, TransformException
    module.TransformListener = lambda buffer, node, **_: SimpleNamespace(buffer=buffer, node=node)
    monkeypatch.setitem(sys.modules, "tf2_ros", module)


def turned(angle, x):
    return pin.SE3(pin.utils.rotate("z", angle), np.array([x, 0.5, 0.0]))


@pytest.fixture
def transforms(tf2):
    """Of a node that has a clock only."""
    return Transforms(SimpleNamespace(get_clock=MagicMock()))


def test_a_transform_is_asked_for_at_the_stamp_and_waited_for_only_where_told(transforms):
    buffer = Buffer.made
    buffer.known["a", "b"] = T = turned(0.2, 3.0)
    found = transforms.pose("a", "b", Time(sec=7), wait=True)
    np.testing.assert_allclose(found.homogeneous, T.homogeneous, atol=1e-12)
    assert buffer.asked[-1][2] == 7 * 10**9
    assert buffer.asked[-1][3] > Duration()
    assert transforms.pose("a", "c") is None
    assert buffer.asked[-1][2:] == (0, Duration())


def test_a_transform_that_is_none_is_not_known(transforms, monkeypatch):
    found = TransformStamped()
    found.transform.rotation.w = 0.0
    monkeypatch.setattr(Buffer, "lookup_transform", lambda *_, **__: found)
    assert transforms.pose("a", "b") is None


@pytest.mark.parametrize(
    ("target", "source", "sent"),
    [
        (f"cell/{ROOT}", "camera", "camera"),  # hung onto the robot by a static transform
        (f"cell/{ROOT}", "cell/camera", "cell/camera"),  # of the description, all prefixed
        (f"cell/{ROOT}", "cell/camera", "camera"),
        (ROOT, "camera", "cell/camera"),
    ],
)
def test_a_node_takes_the_prefix_off_the_frames_of_clouds_and_of_tf(
    tf2, bench, target, source, sent
):
    b = bench(frame_prefix="cell/")
    Buffer.made.known[target, source] = T = turned(0.3, 0.2)
    inputs = b.node._inputs
    own = (TABLE - T.translation) @ T.rotation
    b.wait(lambda: inputs.clouds.updates > 0, again=lambda: b.cloud(own, sent))
    np.testing.assert_allclose(inputs.clouds.latest()["points"].points, TABLE, atol=1e-6)
    b.wait(lambda: b.call("start").success, again=b.joint_state)
    b.call("stop")
