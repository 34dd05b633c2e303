"""Transforms by tf2, where it is installed."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin
from builtin_interfaces.msg import Time as TimeMessage
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

WAIT = Duration(nanoseconds=100_000_000)
"""For how long a cloud waits for its transform."""
SET_BACK = Duration(seconds=-1)
"""From which jump on a clock counts as set back."""


class Transforms:
    """Looks transforms up by tf2; knows none where tf2_ros is not installed.

    The wheels do not have it; a real Jazzy does.

    Args:
        prefix: that robot_state_publisher puts before the names of links.
    """

    def __init__(self, node: Node, prefix: str = "") -> None:
        self._prefix = prefix
        self._buffer: Any = None
        if importlib.util.find_spec("tf2_ros") is None:
            return
        tf2_ros = importlib.import_module("tf2_ros")
        self._error = tf2_ros.TransformException
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer, node)
        # Else the buffer would drop whatever comes after the clock was set back.
        threshold = JumpThreshold(min_forward=None, min_backward=SET_BACK, on_clock_change=True)
        self._jumps = node.get_clock().create_jump_callback(
            threshold, post_callback=lambda _: self._buffer.clear()
        )

    def pose(
        self, target: str, source: str, stamp: TimeMessage | None = None, *, wait: bool = False
    ) -> pin.SE3 | None:
        """T_target_source at the stamp (the newest without one), or None.

        Args:
            wait: a little, where it is not known yet.
        """
        if self._buffer is None:
            return None
        time = Time() if stamp is None else Time.from_msg(stamp)
        for_target, for_source = (
            [f"{self._prefix}{name}", name] if self._prefix else [name] for name in (target, source)
        )
        # the prefix is on both frames, on one or on none
        pairs = list(product(for_target, for_source))
        found = None
        for named in pairs:
            # waited for once only, whatever the number of pairs
            patience = WAIT if wait and named is pairs[0] else Duration()
            with contextlib.suppress(self._error):
                found = self._buffer.lookup_transform(*named, time, timeout=patience).transform
                break
        if found is None:
            return None
        r, t = found.rotation, found.translation
        numbers = np.array([t.x, t.y, t.z, r.x, r.y, r.z, r.w])
        length = float(np.linalg.norm(numbers[3:]))
        # a transform that is no pose counts as unknown
        if not np.isfinite(numbers).all() or length == 0.0:
            return None
        return pin.SE3(pin.Quaternion(numbers[3:] / length).toRotationMatrix(), numbers[:3])
