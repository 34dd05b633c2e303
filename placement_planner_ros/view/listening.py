"""Everything the page hears: the node's results, and what the node itself hears."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2
from shape_msgs.msg import Mesh
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from placement_planner_ros.client.subscriptions import KEPT, Subscriptions
from placement_planner_ros.client.waiting import LONGEST, News
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.cloud_subscriptions import CloudSubscriptions
from placement_planner_ros.ros.inputs.point_cloud import points_from_message, some_of
from placement_planner_ros.ros.paced import Paced
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.ros.spinning import waiting
from placement_planner_ros.ros.timers import every
from placement_planner_ros.view.node_parameters import NodeParameters

LARGE_PERIOD, BESIDE_A_SEARCH = 0.18, 1.0
"""Least seconds between two large messages of one topic that are read; and while the node searches,
which needs the processor."""
MOST_POINTS = 30_000
"""Points of one cloud that are shown."""
_URDF = "<link"
_KINDS = {
    "sensor_msgs/msg/PointCloud2": "cloud",
    "sensor_msgs/msg/JointState": "joints",
    "std_msgs/msg/String": "description",
    "shape_msgs/msg/Mesh": "object",
}


class Listener:
    """Hears the planning node and its inputs. Its attributes are replaced, never changed.

    Which topics its inputs come by is seen from what the node subscribes to, so that it is heard
    whatever its names were mapped to.

    Attributes:
        hearing: status and solutions.
        parameters: the node's.
        positions: newest value of each joint, rad or m.
        clouds: of each topic the newest one's frame and points (n, 3), `MOST_POINTS` at most; the
            same array while it shows the same.
        markers, occupancy: the newest of each; None before.
        description: the newest URDF that came by topic; '' before.
        object: the newest mesh that came by topic, as bytes; None before.
        faults: by topic, what was wrong with the newest message.

    Args:
        planner: the planning node's name.
    """

    def __init__(self, node: Node, planner: str) -> None:
        # what is small comes by one group; what is large has a pace of its own
        self._node = node
        self._group = MutuallyExclusiveCallbackGroup()
        self.planner = node.resolve_service_name(planner)
        self.hearing = Subscriptions(node, planner, self._group, News())
        self.parameters = NodeParameters(node, self.planner, self._group)
        self.positions: dict[str, float] = {}
        self.clouds: dict[str, tuple[str, Array]] = {}
        self.markers: MarkerArray | None = None
        self.occupancy: PointCloud2 | None = None
        self.description = ""
        self.object: bytes | None = None
        self.faults: dict[str, str] = {}
        self._present = False
        self._topics: dict[tuple[str, str], Any] = {}
        for kind, name in ((MarkerArray, "markers"), (PointCloud2, "occupancy")):
            group, take = Paced(self._large_period), partial(setattr, self, name)
            node.create_subscription(kind, f"{planner}/{name}", take, LATCHED, callback_group=group)
        every(node, LONGEST, self.look)

    @property
    def absent(self) -> str:
        """Why nothing is heard of the node, in words; empty where it is there."""
        if self._present:
            return ""
        before = "" if self.hearing.status is None else " any more; what it said last is shown"
        return f"no node heard on {self.planner}{before}"

    def look(self) -> None:
        """See whether the node is there, and what it subscribes to."""
        namespace, _, name = self.planner.rpartition("/")
        # whoever publishes the status is the node
        present = self._node.count_publishers(f"{self.planner}/status") > 0
        if present and not self._present:
            self.parameters.ask_again()
        self._present = present
        self.parameters.look()
        if not present:
            return
        try:
            heard = self._node.get_subscriber_names_and_types_by_node(name, namespace or "/")
        except RuntimeError:  # its topics are known before its name is, or it has just gone
            return
        # each input of the node is heard from the first look that shows it on
        for topic, kinds in heard:
            for kind in filter(None, map(_KINDS.get, kinds)):
                if (topic, kind) not in self._topics:
                    self._topics[topic, kind] = self._listen(topic, kind)

    def _listen(self, topic: str, kind: str) -> Any:
        if kind == "cloud":
            group = Paced(self._large_period)
            return CloudSubscriptions(self._node, [topic], self._take_cloud, group)
        types: dict[str, tuple[type, Callable[[Any], None], QoSProfile]] = {
            "joints": (
                JointState,
                lambda message: self._take_joint_states(topic, message),
                # Several drivers may tell of a part of the robot each, between two looks.
                QoSProfile(depth=KEPT, reliability=ReliabilityPolicy.BEST_EFFORT),
            ),
            "description": (String, self._take_description, LATCHED),
            "object": (Mesh, partial(setattr, self, "object"), LATCHED),
        }
        message, take, qos = types[kind]
        # meshes as bytes, so that no message is made for each triangle
        return self._node.create_subscription(
            message, topic, take, qos, callback_group=self._group, raw=message is Mesh
        )

    def _large_period(self) -> float:
        # a search needs the processor more than the page does
        status = self.hearing.status
        searching = status is not None and status.run > 0 and not status.ended
        return BESIDE_A_SEARCH if searching else LARGE_PERIOD

    def _take_cloud(self, topic: str, message: PointCloud2) -> None:
        try:
            points = some_of(points_from_message(message), MOST_POINTS)
        except PlacementPlannerError as error:
            self._fault(topic, str(error))
            return
        _, before = self.clouds.get(topic, ("", None))
        if before is not None and np.array_equal(before, points):
            points = before
        self.clouds = {**self.clouds, topic: (message.header.frame_id, points)}
        self._fault(topic, "")

    def _take_joint_states(self, topic: str, message: JointState) -> None:
        # drivers may send several between two looks
        for each in (message, *waiting(self._topics[topic, "joints"], KEPT)):
            names, position = each.name, each.position
            fits = len(names) == len(position)
            words = f"{len(names)} names and {len(position)} positions"
            self._fault(topic, "" if fits else words)
            # joints that nobody measures are left as they were
            values = zip(names, map(float, position), strict=True) if fits else ()
            self.positions = self.positions | {n: v for n, v in values if math.isfinite(v)}

    def _take_description(self, message: String) -> None:
        if _URDF in message.data:  # the node's other string is the SRDF
            self.description = message.data

    def _fault(self, topic: str, words: str) -> None:
        if self.faults.get(topic, "") != words:
            others = {name: said for name, said in self.faults.items() if name != topic}
            self.faults = {**others, topic: words} if words else others
