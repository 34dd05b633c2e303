"""tf2, where it is installed. The wheels do not have it; a real Jazzy does."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

import numpy as np
import pinocchio as pin
from builtin_interfaces.msg import Time as TimeMessage
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

WAIT = Duration(nanoseconds=100_000_000)


class Transforms:
    """Looks transforms up; knows none where tf2_ros is not installed."""

    def __init__(self, node: Node) -> None:
        self._buffer: Any = None
        if importlib.util.find_spec("tf2_ros") is not None:
            tf2_ros = importlib.import_module("tf2_ros")
            self._error = tf2_ros.TransformException
            self._buffer = tf2_ros.Buffer()
            self._listener = tf2_ros.TransformListener(self._buffer, node, spin_thread=True)

    @property
    def available(self) -> bool:
        """Whether tf2_ros is installed."""
        return self._buffer is not None

    def pose(self, target: str, source: str, stamp: TimeMessage | None = None) -> pin.SE3 | None:
        """T_target_source at the stamp (the newest without one), or None."""
        if self._buffer is None:
            return None
        time = Time() if stamp is None else Time.from_msg(stamp)
        try:
            found = self._buffer.lookup_transform(target, source, time, timeout=WAIT).transform
        except self._error:
            return None
        r, t = found.rotation, found.translation
        rotation = pin.Quaternion(np.array([r.x, r.y, r.z, r.w])).normalized().toRotationMatrix()
        return pin.SE3(rotation, np.array([t.x, t.y, t.z]))
