"""What reaches the node from outside: its topics, and parameters that change what it is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2
from shape_msgs.msg import Mesh
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from placement_planner_ros.core.errors import JointStateError, PlacementPlannerError, listed
from placement_planner_ros.ros.call_priority import CallPriority
from placement_planner_ros.ros.inputs.cloud_subscriptions import CloudSubscriptions
from placement_planner_ros.ros.inputs.furniture import WORLD_LINKS, require_links
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.inputs.mesh_message import mesh_from_message
from placement_planner_ros.ros.inputs.object_input import NoObjectError
from placement_planner_ros.ros.inputs.reading import NotReadyError
from placement_planner_ros.ros.inputs.robot_input import require_known
from placement_planner_ros.ros.log import Log
from placement_planner_ros.ros.parameters.server import ParameterServer
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.ros.spinning import waiting

_KEPT = 10
"""Joint states that the middleware keeps until they are looked at."""
_KNOWN = QoSProfile(
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Of known objects, of which each message may tell of others."""


class Reception:
    """Hands what arrives to the inputs, and logs what they refuse.

    Args:
        topics: of clouds.
        on_joints: called after each joint state.
        log: hears of what is read or refused.
        calls: clouds give way to their answers.

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
        log: Log,
        calls: CallPriority,
    ) -> None:
        self._calls = calls
        self._log = log
        self._inputs = inputs
        self._parameters = parameters
        self._on_joints = on_joints
        parameters.check_with(self._check)
        parameters.notify(self._changed)
        self.clouds = CloudSubscriptions(node, topics, self._take_cloud)
        self._joint_states = node.create_subscription(
            JointState,
            "joint_states",
            self._take_joint_states,
            QoSProfile(depth=_KEPT, reliability=ReliabilityPolicy.BEST_EFFORT),
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
        node.create_subscription(
            Mesh, "~/object", self._take_object, LATCHED, callback_group=descriptions, raw=True
        )
        node.create_subscription(
            MarkerArray, "~/known_objects", self._take_known, _KNOWN, callback_group=descriptions
        )
        robot.reading.listen(self._tell_of_robot)
        robot.follow_progress(self._log.event)
        inputs.object.reading.listen(self._tell_of_object)
        inputs.object.follow_progress(self._log.event)
        self._tell_of_fault()

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
            self._inputs.clouds.refuse(topic, error)
            self._log.repeats(f"cloud on {topic} refused", str(error))

    def _take_joint_states(self, message: JointState) -> None:
        # Several drivers may tell of a part of the robot each: of none may all be dropped.
        for each in (message, *waiting(self._joint_states, _KEPT)):
            try:
                self._inputs.take_joint_state(each)
            except JointStateError as error:
                self._log.repeats("joint state refused", str(error))
        self._on_joints()  # as some of its joints may have been taken

    def _take_description(self, message: String) -> None:
        self._inputs.robot.set_description(message.data)

    def _take_semantic(self, message: String) -> None:
        self._inputs.robot.set_semantic(message.data)

    def _tell_of_robot(self, _: object) -> None:
        try:
            robot = self._inputs.robot.robot
        except NotReadyError:
            return
        except PlacementPlannerError as error:
            self._tell_of_refusal("robot description refused", error)
            return
        words = f"robot {robot.name!r} read, planning frame {robot.root_link!r}"
        self._log.news("robot read", listed([words, *robot.warnings], "; "))

    def _tell_of_object(self, key: object) -> None:
        try:
            body = self._inputs.object.reading.get(key)
        except NotReadyError:
            return
        except PlacementPlannerError as error:
            self._tell_of_refusal("object refused", error)
            return
        words = [f"{len(body.triangles)} triangles", *body.assumed, *body.warnings]
        self._log.news("object read", f"object read: {'; '.join(words)}")

    def _tell_of_refusal(self, kind: str, error: PlacementPlannerError) -> None:
        """That something could not be read, and where in the code if nobody expected that."""
        self._log.repeats(kind, str(error))
        cause, expected = error.__cause__, (PlacementPlannerError, ValueError, OSError)
        if cause is not None and not isinstance(cause, expected):
            self._log.fault(f"{kind} for a fault", cause)

    def _take_object(self, message: bytes) -> None:
        try:
            mesh = mesh_from_message(message)
        except PlacementPlannerError as error:
            self._inputs.object.refuse_mesh(error)
            self._log.repeats("object refused", str(error))
        else:
            self._inputs.object.set_mesh(*mesh)

    def _check(self, names: Sequence[str], parameters: ParameterSet) -> None:
        """Refuse what the robot does not have, and what shows that it is no object."""
        source = self._inputs.robot
        if source.is_given and source.state == "ready":  # else start tells it
            require_known(source.robot, parameters, names)
            if {WORLD_LINKS, "self_filter.padding_of"} & {*names}:
                require_links(source.robot, parameters)
        self._inputs.object.check(parameters, names)

    def _changed(self, names: Sequence[str], parameters: ParameterSet) -> None:
        self._inputs.object.parameters_changed(names, parameters)
        if any(name.startswith("object.") for name in names):
            self._tell_of_fault()

    def _tell_of_fault(self) -> None:
        fault = self._inputs.object.fault
        if fault is not None and not isinstance(fault, NoObjectError):
            self._log.repeats("object refused", str(fault))
