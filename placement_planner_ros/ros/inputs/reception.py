"""What reaches the node from outside: its topics, and parameters that change what it is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2
from shape_msgs.msg import Mesh
from std_msgs.msg import String

from placement_planner_ros.core.errors import JointStateError, ObjectError, PlacementPlannerError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.ros.inputs.cloud_subscriptions import CloudSubscriptions
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.inputs.object_input import NoObjectError, mesh_from_message
from placement_planner_ros.ros.inputs.robot_input import require_known
from placement_planner_ros.ros.parameters.server import ParameterServer
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.qos import LATCHED


class Reception:
    """Hands what arrives to the inputs, and logs what they refuse.

    Args:
        topics: of clouds.
        on_joints: called after each joint state.

    Attributes:
        clouds: the subscriptions to clouds.
    """

    def __init__(
        self,
        node: Node,
        inputs: Inputs,
        parameters: ParameterServer,
        topics: Sequence[str],
        on_joints: Callable[[], None],
    ) -> None:
        self._log = node.get_logger()
        self._inputs = inputs
        self._parameters = parameters
        self._on_joints = on_joints
        self._said: set[str] = set()
        parameters.check_with(self._check)
        parameters.notify(self._changed)
        self.clouds = CloudSubscriptions(node, topics, self._take_cloud)
        node.create_subscription(
            JointState,
            "joint_states",
            self._take_joint_state,
            QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT),
            callback_group=MutuallyExclusiveCallbackGroup(),
        )
        descriptions = MutuallyExclusiveCallbackGroup()

        def latched(kind: type, topic: str, take: Callable[..., None]) -> None:
            node.create_subscription(kind, topic, take, LATCHED, callback_group=descriptions)

        robot = inputs.robot
        if robot.follows_topic:
            latched(String, "robot_description", self._take_description)
        if robot.follows_semantic_topic:
            latched(String, "robot_description_semantic", self._take_semantic)
        latched(Mesh, "~/object", self._take_object)
        self._prepare_object()

    def _take_cloud(self, topic: str, message: PointCloud2) -> None:
        try:
            self._inputs.take_cloud(topic, message, self._parameters.current)
        except PlacementPlannerError as error:
            if self._inputs.clouds.refuse(topic, error):
                self._log.warning(f"cloud on {topic} refused: {error}")

    def _take_joint_state(self, message: JointState) -> None:
        try:
            self._inputs.take_joint_state(message)
        except JointStateError as error:
            if str(error) not in self._said:
                self._said.add(str(error))
                self._log.warning(f"joint state refused: {error}")
            return
        self._on_joints()

    def _take_description(self, message: String) -> None:
        self._read_robot(self._inputs.robot.set_description, message.data)

    def _take_semantic(self, message: String) -> None:
        self._read_robot(self._inputs.robot.set_semantic, message.data)

    def _read_robot(self, read: Callable[[str], Robot | None], text: str) -> None:
        try:
            robot = read(text)
        except PlacementPlannerError as error:
            self._log.error(f"robot description refused: {error}")
            return
        if robot is not None:
            self._log.info(f"took robot {robot.name!r} from its description topic")

    def _take_object(self, message: Mesh) -> None:
        self._inputs.object.set_mesh(*mesh_from_message(message))
        self._prepare_object()

    def _check(self, names: Sequence[str], parameters: ParameterSet) -> None:
        """Refuse what the robot does not have, and meshes that are no object.

        Vertices and triangles may be set one after the other, so they are checked together only
        when both are given.
        """
        source = self._inputs.robot
        if source.is_given:
            require_known(source.robot, parameters, names)
        if parameters["object.mesh"] and "object.mesh" in names:
            self._inputs.object.body(parameters, ["object.mesh"])
        elif {"object.vertices", "object.triangles"} <= set(names):
            self._inputs.object.body(parameters, names)

    def _changed(self, names: Sequence[str], parameters: ParameterSet) -> None:
        self._inputs.object.parameters_changed(names, parameters)
        if any(name.startswith("object.") for name in names):
            self._prepare_object()

    def _prepare_object(self) -> None:
        """Make the body now, so that start finds it ready; say what is wrong with it."""
        try:
            self._inputs.object.body(self._parameters.current)
        except NoObjectError:
            return
        except ObjectError as error:
            self._log.warning(f"object refused: {error}")
