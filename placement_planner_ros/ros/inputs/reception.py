"""Reception of what comes from outside: topics, and parameters that change what is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2
from shape_msgs.msg import Mesh
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from placement_planner_ros.core.errors import JointStateError, PlacementPlannerError
from placement_planner_ros.ros.call_priority import CallPriority
from placement_planner_ros.ros.inputs.cloud_subscriptions import CloudSubscriptions
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.inputs.mesh_message import mesh_from_message
from placement_planner_ros.ros.inputs.robot_input import require_known
from placement_planner_ros.ros.log import Log
from placement_planner_ros.ros.parameters.server import ParameterServer
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.qos import LATCHED, latched
from placement_planner_ros.ros.spinning import waiting

KEPT_STATES = 10
"""Joint states that the middleware keeps until they are looked at."""


class Reception:
    """Hands what arrives to the inputs, and logs what they refuse.

    Args:
        on_joints: called after each joint state.
        log: hears of what is refused.
        calls: clouds give way to their answers.

    Attributes:
        clouds: the subscriptions to clouds.
    """

    def __init__(
        self,
        node: Node,
        inputs: Inputs,
        parameters: ParameterServer,
        on_joints: Callable[[], None],
        log: Log,
        calls: CallPriority,
    ) -> None:
        self._calls = calls
        self._log = log
        self._inputs = inputs
        self._parameters = parameters
        self._on_joints = on_joints
        parameters.check = self._check
        parameters.on_change = inputs.object.parameters_changed
        topics = dict.fromkeys(["points", *parameters.current["cloud_topics"]])
        self.clouds = CloudSubscriptions(node, list(topics), self._take_cloud)
        # best effort, which hears reliable publishers too
        self._joint_states = node.create_subscription(
            JointState,
            "joint_states",
            self._take_joint_states,
            QoSProfile(depth=KEPT_STATES, reliability=ReliabilityPolicy.BEST_EFFORT),
            callback_group=MutuallyExclusiveCallbackGroup(),
        )
        # descriptions and objects are taken in one at a time
        robot, group = inputs.robot, MutuallyExclusiveCallbackGroup()
        subscribe: Any = partial(node.create_subscription, callback_group=group)
        if robot.follows_topic:
            subscribe(String, "robot_description", lambda m: robot.set_description(m.data), LATCHED)
        if robot.follows_semantic_topic:
            topic = "robot_description_semantic"
            subscribe(String, topic, lambda m: robot.set_semantic(m.data), LATCHED)
        # as bytes, so that no message is made for each triangle
        subscribe(Mesh, "~/object", self._take_object, LATCHED, raw=True)
        # each may tell of others
        subscribe(MarkerArray, "~/known_objects", self._take_known, latched(100))

    def _take_known(self, message: MarkerArray) -> None:
        for fault in self._inputs.known.take(message):
            self._log.repeats("known object refused", str(fault))

    def _take_cloud(self, topic: str, message: PointCloud2) -> None:
        self._calls.give_way()
        try:
            self._inputs.take_cloud(topic, message, self._parameters.current)
            if self._inputs.turned.get(topic):
                self._log.repeats(f"cloud on {topic} turned", self._inputs.turned[topic])
        except PlacementPlannerError as error:
            # kept with its topic, so that a start can tell it
            self._inputs.clouds.refuse(topic, error)
            self._log.repeats(f"cloud on {topic} refused", str(error))

    def _take_joint_states(self, message: JointState) -> None:
        # Several drivers may tell of a part of the robot each: of none may all be dropped.
        for each in (message, *waiting(self._joint_states, KEPT_STATES)):
            try:
                self._inputs.take_joint_state(each)
            except JointStateError as error:
                self._log.repeats("joint state refused", str(error))
        self._on_joints()  # as some of its joints may have been taken

    def _take_object(self, message: bytes) -> None:
        try:
            self._inputs.object.take(mesh_from_message(message))
        except PlacementPlannerError as error:
            self._inputs.object.take(error)

    def _check(self, names: Sequence[str], parameters: ParameterSet) -> None:
        """Refuse what the robot does not have, and what shows that it is no object."""
        source = self._inputs.robot
        if source.is_given and source.state == "ready":  # else start tells it
            require_known(source.robot, parameters, names)
        self._inputs.object.check(parameters, names)
