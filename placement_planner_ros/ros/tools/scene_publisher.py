"""`placement_scene`: one bundled scene as cameras and a robot would publish it."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Header, String

from placement_planner_ros.core.errors import ParameterError, PlacementPlannerError
from placement_planner_ros.interrupts import catch_signals
from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.process import begin_ros
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.ros.spinning import spin_until
from placement_planner_ros.ros.timers import every
from placement_planner_ros.scenes.clouds import camera_clouds, complete_cloud
from placement_planner_ros.scenes.scenes import BUNDLED_SCENES, Scene, scene_by_name
from placement_planner_ros.scenes.yumi import start_configuration
from placement_planner_ros.share import share_path

FRAME = "yumi_body"
JOINT_STATE_RATE = 50.0
"""Hz."""

_DESCRIPTIONS = {"robot_description": "yumi.urdf", "robot_description_semantic": "yumi.srdf"}
RELIABLE = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)


class ScenePublisher(Node):
    """Publishes clouds, joint states and the robot's description.

    The complete surface goes to `points` in the planning frame; the cameras' views go to
    `<camera>/points`, in the cameras' optical frames.

    Args:
        own: a scene, joint values by name and the planning frame, instead of what is bundled; the
            robot's description is not published then.

    Raises:
        ParameterError: an unknown scene, object or kind of cloud.
    """

    def __init__(
        self,
        overrides: Sequence[Parameter] = (),
        own: tuple[Scene, Mapping[str, float], str] | None = None,
    ) -> None:
        super().__init__("placement_scene", parameter_overrides=list(overrides))

        def given(name: str, default: object, text: str) -> Any:
            words = ParameterDescriptor(description=text, dynamic_typing=True)
            return self.declare_parameter(name, default, words).value

        name = given("name", "cabinet_high_clutter", f"Scene: {', '.join(BUNDLED_SCENES)}.")
        held = given("object", "small_crayons_box", "Object that the fingers are closed around.")
        kind = given(
            "clouds", "complete", "complete: the whole surface; cameras: what two cameras see."
        )
        rate = given("rate", 2.0, "Clouds per second.")
        if type(rate) not in (int, float) or not 0.0 < rate <= 100.0:
            raise ParameterError("rate", rate, "must be above 0 and at most 100 Hz")
        if own is None:
            own = scene_by_name(str(name)), start_configuration(str(held)), FRAME
            for topic, file in _DESCRIPTIONS.items():
                text = share_path("urdf", file).read_text(encoding="utf-8")
                self.create_publisher(String, topic, LATCHED).publish(String(data=text))
        scene, positions, frame = own
        self._positions = dict(positions)
        self._clouds = self._make_clouds(scene, kind, frame)
        self._joint_states = self.create_publisher(JointState, "joint_states", 10)
        every(self, 1.0 / rate, self._publish_clouds)
        every(self, 1.0 / JOINT_STATE_RATE, self._publish_joint_states)
        self.get_logger().info(f"publishing scene {scene.name}, clouds: {kind}")

    def show(self, positions: Mapping[str, float]) -> None:
        """Where the joints, by name, are from now on; may be called from any thread."""
        self._positions = dict(positions)

    def _make_clouds(
        self, scene: Scene, kind: object, planning_frame: str
    ) -> list[tuple[Publisher, PointCloud2]]:
        if kind == "complete":
            seen: dict[str, tuple[str, Any]] = {"points": (planning_frame, complete_cloud(scene))}
        elif kind == "cameras":
            seen = {
                f"{cloud.camera.name.removesuffix('_optical_frame')}/points": (
                    cloud.camera.name,
                    cloud.points,
                )
                for cloud in camera_clouds(scene, np.random.default_rng(0))
            }
        else:
            raise ParameterError("clouds", kind, "choose complete or cameras")
        return [
            (
                self.create_publisher(PointCloud2, topic, RELIABLE),
                message_from_points(points, Header(frame_id=frame)),
            )
            for topic, (frame, points) in seen.items()
        ]

    def _publish_clouds(self) -> None:
        for publisher, message in self._clouds:
            message.header.stamp = self.get_clock().now().to_msg()
            publisher.publish(message)

    def _publish_joint_states(self) -> None:
        now = self.get_clock().now().to_msg()
        self._joint_states.publish(joint_state_at_rest(self._positions, now))


def joint_state_at_rest(positions: Mapping[str, float], stamp: Time) -> JointState:
    """The joints' positions, rad or m, as a robot that stands still publishes them."""
    return JointState(
        header=Header(stamp=stamp),
        name=list(positions),
        position=list(positions.values()),
        velocity=[0.0] * len(positions),
    )


def main(args: list[str] | None = None) -> None:
    """Publish until interrupted."""
    asked = catch_signals()
    begin_ros(args)
    try:
        node = ScenePublisher()
    except (PlacementPlannerError, ParameterException) as error:
        sys.exit(f"placement_scene: {error}")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spin_until(executor, asked)
    # before the node goes, which the executor waits on
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
