"""Publishes a table of things and a resting robot, for any robot and target volume."""

from __future__ import annotations

from rclpy.node import Node
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Header

from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.timers import every
from placement_planner_ros.ros.tools.scene_publisher import (
    JOINT_STATE_RATE,
    RELIABLE,
    joint_state_at_rest,
)
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.scenes import Scene


class ThingsPublisher(Node):
    """The whole surface on `points`, in the planning frame, and the start as joint states."""

    def __init__(self, scene: Scene, subject: Snapshot) -> None:
        super().__init__("placement_scene")
        robot = subject.robot
        self._positions = {
            name: float(value)
            for name, value in zip(robot.joint_names, subject.q_start, strict=True)
            if name not in robot.mimics
        }
        self._clouds = self.create_publisher(PointCloud2, "points", RELIABLE)
        self._cloud = message_from_points(complete_cloud(scene), Header(frame_id=robot.root_link))
        self._joint_states = self.create_publisher(JointState, "joint_states", 10)
        every(self, 0.5, self._publish_cloud)
        every(self, 1.0 / JOINT_STATE_RATE, self._publish_joint_states)

    def _publish_cloud(self) -> None:
        self._cloud.header.stamp = self.get_clock().now().to_msg()
        self._clouds.publish(self._cloud)

    def _publish_joint_states(self) -> None:
        stamp = self.get_clock().now().to_msg()
        self._joint_states.publish(joint_state_at_rest(self._positions, stamp))
