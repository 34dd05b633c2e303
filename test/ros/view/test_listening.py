"""What the page hears of nodes, of none, and of messages that are none."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point
from helpers.fakes import Spinning
from helpers.system import wait
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Header, String
from visualization_msgs.msg import Marker, MarkerArray

from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.view.drawn_markers import drawn_points
from placement_planner_ros.view.listening import Listener
from placement_planner_ros.view.world import World


class Planner(Node):
    """As much of the planning node as is heard: inputs under other names, and its status."""

    def __init__(self):
        super().__init__("placement_planner")
        for kind, topic in ((PointCloud2, "depth"), (JointState, "arm_states"), (String, "robot")):
            self.create_subscription(kind, topic, lambda _: None, 1)
        self.status = self.create_publisher(DiagnosticStatus, "~/status", LATCHED)
        self.solution = self.create_publisher(DiagnosticArray, "~/solution", LATCHED)
        self.depth = self.create_publisher(PointCloud2, "depth", 1)
        self.arm_states = self.create_publisher(JointState, "arm_states", 1)

    def say(self, **values):
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        self.status.publish(DiagnosticStatus(values=pairs))


@pytest.fixture
def heard(ros):
    """A planning node, and who listens to it."""
    planner, page = Planner(), Node("page")
    planner.declare_parameter("planning_frame", "world")
    listener = Listener(page, "placement_planner")
    executor = SingleThreadedExecutor()
    executor.add_node(planner)
    executor.add_node(page)
    dropped = []
    spin_once = executor.spin_once

    def surviving(*arguments, **named):  # as the page's own spinning does
        try:
            spin_once(*arguments, **named)
        except Exception as error:
            dropped.append(error)

    executor.spin_once = surviving
    spinning = Spinning(executor)
    yield planner, listener, dropped
    spinning.end()
    planner.destroy_node()
    page.destroy_node()


def test_inputs_are_heard_whatever_their_names_and_whatever_comes_by_them(heard):
    planner, listener, dropped = heard
    wait(lambda: listener.absent == "" and listener.parameters.values)
    assert listener.parameters.values["planning_frame"] == "world"

    def clouds():
        planner.depth.publish(message_from_points(np.ones((5, 3)), Header(frame_id="world")))
        return listener.clouds

    wait(clouds)
    frame, points = listener.clouds["/depth"]
    assert len(points) == 5
    world = World(listener, lambda *_: None)
    assert world.frame_pose(frame, {}).isIdentity()
    assert world.frame_pose("elsewhere", {}) is None

    def refused():
        bad = message_from_points(np.ones((5, 3)), Header())
        bad.data = bad.data[:7]
        planner.depth.publish(bad)
        return listener.faults

    wait(refused)
    assert "7 bytes" in listener.faults["/depth"]

    def joints():
        values = [1.0, float("nan")]
        planner.arm_states.publish(JointState(name=["a", "b"], position=values))
        return listener.positions

    wait(joints)
    assert listener.positions == {"a": 1.0}

    planner.solution.publish(DiagnosticArray())  # without a status
    wait(lambda: dropped)
    planner.say(run=3, state="searching", solutions=0)
    wait(lambda: listener.hearing.status is not None)
    assert listener.hearing.status.run == 3


def test_markers_that_are_none_are_refused_or_left_out():
    volume = Marker(ns="target_volume", type=Marker.CUBE)
    volume.scale.x = volume.scale.y = volume.scale.z = 0.5
    held = Marker(ns="contacts", points=[Point(x=float(k)) for k in range(5)])
    drawn = drawn_points(MarkerArray(markers=[volume, held, Marker(ns="another's")]))
    assert drawn["contacts"][:, 0].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert drawn["target_volume"].tolist() == [[[-0.25] * 3, [0.25] * 3]]
    assert len(drawn["regions"]) == 0
    volume.pose.position.x = float("nan")
    with pytest.raises(ValueError, match="finite"):
        drawn_points(MarkerArray(markers=[volume]))
