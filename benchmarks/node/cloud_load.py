"""Three large noisy clouds as three cameras publish them, and joint states: load for the node.

`node_load` starts this as a process of its own. Clouds come while the topic `load` says so, and
once for each topic before it says anything.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Bool, Header

from placement_planner_ros.core.types import Array
from placement_planner_ros.interrupts import catch_signals
from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.ros.spinning import spin_until
from placement_planner_ros.ros.tools.scene_publisher import (
    FRAME,
    JOINT_STATE_RATE,
    RELIABLE,
    joint_state_at_rest,
)
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import start_configuration

TOPICS = ("front/points", "left/points", "right/points")
POINTS = 300_000
"""Of each cloud."""
RATE = 10.0
"""Clouds per second on each topic."""
NOISE = 0.0005
"""Standard deviation of every coordinate, metres."""
_VARIANTS = 3
"""Clouds of each topic that take turns, so that each shows something new."""


def many_points(scene: str, seed: int) -> Array:
    """(POINTS, 3) noisy points of a bundled scene's surface."""
    rng = np.random.default_rng(seed)
    surface = complete_cloud(scene_by_name(scene))
    points = surface[rng.integers(len(surface), size=POINTS)]
    return np.asarray(points + rng.normal(0.0, NOISE, points.shape))


class CloudLoad(Node):
    """Publishes the clouds and the robot's joint states."""

    def __init__(self, scene: str, held: str) -> None:
        super().__init__("placement_load")
        self._clouds: list[tuple[Publisher, list[PointCloud2]]] = [
            (
                self.create_publisher(PointCloud2, topic, RELIABLE),
                [
                    message_from_points(many_points(scene, 10 * i + k), Header(frame_id=FRAME))
                    for k in range(_VARIANTS)
                ],
            )
            for i, topic in enumerate(TOPICS)
        ]
        self._positions = start_configuration(held)
        self._joint_states = self.create_publisher(JointState, "joint_states", 10)
        self._told: bool | None = None
        self._count = 0
        self.create_subscription(Bool, "load", self._tell, LATCHED)
        self.create_timer(1.0 / JOINT_STATE_RATE, self._publish_joint_states)
        self.create_timer(1.0 / (RATE * len(TOPICS)), self._publish_cloud)

    def _tell(self, message: Bool) -> None:
        self._told = bool(message.data)

    def _publish_cloud(self) -> None:
        """The next topic's, one after the other, as cameras are not triggered together."""
        if self._told is False:
            return
        publisher, variants = self._clouds[self._count % len(TOPICS)]
        if publisher.get_subscription_count() == 0:
            return
        message = variants[self._count // len(TOPICS) % _VARIANTS]
        message.header.stamp = self.get_clock().now().to_msg()
        publisher.publish(message)
        self._count += 1

    def _publish_joint_states(self) -> None:
        stamp = self.get_clock().now().to_msg()
        self._joint_states.publish(joint_state_at_rest(self._positions, stamp))


def main(arguments: Sequence[str] | None = None) -> None:
    """Publish until interrupted; arguments: scene, object, then ROS's own."""
    asked = catch_signals()
    words = list(sys.argv[1:] if arguments is None else arguments)
    rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
    node = CloudLoad(words[0], words[1])
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spin_until(executor, asked)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
