"""The node's outputs. For one solution the parts come first, the manifest last."""

from __future__ import annotations

import threading
from collections.abc import Mapping

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.time import Time as RosTime
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64, Header
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import Marker, MarkerArray

from placement_planner_ros.core.scene.environment import Environment, level_with_largest
from placement_planner_ros.core.scene.keep_out import boxes_of, cut
from placement_planner_ros.core.types import Array, Placement
from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.node_words import in_node_words
from placement_planner_ros.ros.outputs.answers import shown
from placement_planner_ros.ros.outputs.conversions import (
    pose_message,
    trajectory_message,
    with_all_joints,
)
from placement_planner_ros.ros.outputs.markers import placement_markers, scene_markers
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.ros.run.snapshot import Snapshot

STATUS_PERIOD_S = 0.5
"""Between status messages while searching, at least, unless the state changes."""


class Outputs:
    """Publishers of one node. Safe to use from several threads."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._lock = threading.RLock()
        self._last_stamp = 0
        self._scene: list[Marker] = []
        self._undrawn: tuple[Snapshot, Environment] | None = None

        def publisher(kind: type, topic: str, qos: QoSProfile | int) -> Publisher:
            # The executor looks at every event of every publisher each time that it wakes, a
            # hundred times a second; of one that is incompatible the subscriber is told too.
            quiet = PublisherEventCallbacks(use_default_callbacks=False)
            return node.create_publisher(kind, topic, qos, event_callbacks=quiet)

        self._trajectory = publisher(JointTrajectory, "~/trajectory", LATCHED)
        self._retreat = publisher(JointTrajectory, "~/retreat_trajectory", LATCHED)
        self._pose = publisher(PoseStamped, "~/placement_pose", LATCHED)
        self._objective = publisher(Float64, "~/objective", LATCHED)
        self._solution = publisher(DiagnosticArray, "~/solution", LATCHED)
        self._status = publisher(DiagnosticStatus, "~/status", LATCHED)
        self._markers = publisher(MarkerArray, "~/markers", LATCHED)
        self._occupancy = publisher(PointCloud2, "~/occupancy", LATCHED)
        self._diagnostics = publisher(DiagnosticArray, "/diagnostics", 10)

    def clear(self, run: int, frame: str) -> None:
        """A run begins: withdraw whatever is latched from the one before."""
        key = f"{run}/0"
        with self._lock:
            self._undrawn = None
            self._trajectory.publish(trajectory_message(None, key))
            self._retreat.publish(trajectory_message(None, key))
            self._markers.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
            header = Header(frame_id=frame, stamp=self._stamp())
            self._occupancy.publish(message_from_points(np.empty((0, 3)), header))
            # a manifest of solution 0 withdraws those of the run before
            values = {"run": run, "solution": 0, "has_retreat": "false"}
            words = f"run {run} has no solution yet"
            self._solution.publish(self._manifest(header, words, values))

    def environment(self, snapshot: Snapshot, environment: Environment) -> None:
        """Obstacle set and regions, once they are known.

        They are drawn by `draw`, as that takes time which the search for a first placement needs.
        """
        with self._lock:
            self._undrawn = snapshot, environment

    def draw(self) -> None:
        """Publish obstacle set and regions, where that has not been done yet."""
        with self._lock:
            if self._undrawn is None:
                return
            snapshot, environment = self._undrawn
            self._undrawn = None
            header = Header(frame_id=snapshot.frame, stamp=self._now())
            obstacles = environment.obstacles
            centres = (obstacles.lower + obstacles.upper) / 2
            self._occupancy.publish(message_from_points(centres, header))
            volume, keep_out = snapshot.parameters.volume, snapshot.parameters["keep_out"]
            # regions as the search has them
            boxes = boxes_of(keep_out)
            regions = cut(environment.regions, boxes) if keep_out else environment.regions
            if snapshot.parameters["support_region"] == "largest":
                regions = level_with_largest(regions)
            standing = [part.points for part in snapshot.parts if part.placed]
            self._scene = scene_markers(header, volume, boxes, regions, standing)
            self._markers.publish(MarkerArray(markers=self._scene))

    def solution(
        self, run: int, number: int, placement: Placement, search_time: float, snapshot: Snapshot
    ) -> None:
        """Publish one placement, found `search_time` seconds after the run's start.

        Its markers come last, as nobody acts on them.
        """
        # the motion, with all joints where a controller wants them
        key, goal, frame = f"{run}/{number}", placement.goal, snapshot.frame
        trajectory, retreat = placement.trajectory, placement.retreat
        if snapshot.parameters["trajectory_joints"] == "all":
            robot, q = snapshot.robot, snapshot.q_start
            trajectory = with_all_joints(trajectory, robot, q)
            if retreat is not None:
                # on the way back the fingers stay open
                opened = robot.with_open_hand(q, snapshot.arm(goal.arm))
                retreat = with_all_joints(retreat, robot, opened)
        T, objective = placement.T_world_object, float(placement.objective)
        # the manifest: numbers for programs, then words
        values = {
            "run": run,
            "solution": number,
            "objective": objective,
            "arm": goal.arm,
            "grasp": goal.grasp,
            "face": goal.face,
            "approach_start": f"{placement.approach_start:.3f}",
            "has_retreat": str(retreat is not None).lower(),
            "search_time": f"{search_time:.3f}",
        } | {f"term.{name}": value for name, value in placement.terms}
        # left out where nobody knows it
        if placement.unseen is not None:
            values["unseen"] = f"{placement.unseen:.4f}"
        if placement.gap is not None:
            values["gap"] = placement.gap
        resting = placement.resting
        if resting is not None:
            values |= {"contact": resting.contact, "leans_on": resting.on}
        words = (
            f"solution {number} after {search_time:.2f} s: arm {goal.arm}, to "
            + "{:.3f} {:.3f} {:.3f}".format(*T.translation)
            + f" in {frame}, objective {objective:.4g}, motion {trajectory.duration:.1f} s"
        )
        if retreat is not None:
            words += f", retreat {retreat.duration:.1f} s"
        if resting is not None and resting.on:
            words += f", leaning on {resting.on}"
        if placement.unseen:
            words += f", {placement.unseen:.1%} of the way where no sensor looked"
        if placement.terms:
            words += "; " + ", ".join(f"{name} {term:.3g}" for name, term in placement.terms)
        with self._lock:
            # parts first, the manifest last
            header = Header(frame_id=frame, stamp=self._stamp())
            self._trajectory.publish(trajectory_message(trajectory, key))
            self._retreat.publish(trajectory_message(retreat, key))
            self._pose.publish(PoseStamped(header=header, pose=pose_message(T)))
            self._objective.publish(Float64(data=objective))
            self._solution.publish(self._manifest(header, words, values))
            self.draw()
            drawn = placement_markers(
                header, snapshot.body, T, tip_path(placement, snapshot), resting
            )
            self._markers.publish(MarkerArray(markers=self._scene + drawn))

    def status(self, level: bytes, message: str, values: Mapping[str, object]) -> None:
        """What the node is doing."""
        self._status.publish(self._statement(level, message, values))

    def diagnostics(self, level: bytes, message: str, values: Mapping[str, object]) -> None:
        """Input ages and state, for whoever collects diagnostics."""
        header = Header(stamp=self._now())
        self._diagnostics.publish(self._manifest(header, message, values, level))

    def _manifest(
        self,
        header: Header,
        words: str,
        values: Mapping[str, object],
        level: bytes = DiagnosticStatus.OK,
    ) -> DiagnosticArray:
        return DiagnosticArray(header=header, status=[self._statement(level, words, values)])

    def _statement(
        self, level: bytes, words: str, values: Mapping[str, object]
    ) -> DiagnosticStatus:
        pairs = [KeyValue(key=name, value=in_node_words(shown(v))) for name, v in values.items()]
        name = self._node.get_name()
        return DiagnosticStatus(level=level, name=name, message=in_node_words(words), values=pairs)

    def _now(self) -> Time:
        return self._node.get_clock().now().to_msg()

    def _stamp(self) -> Time:
        """The time, later than that of any manifest before."""
        # clients find a manifest's pose by its stamp, and the clock may stand still or be set back
        self._last_stamp = max(self._last_stamp + 1, self._node.get_clock().now().nanoseconds)
        return RosTime(nanoseconds=self._last_stamp).to_msg()


def tip_path(placement: Placement, snapshot: Snapshot) -> Array:
    """(n, 3) positions of the arm's tip along the trajectory."""
    robot = snapshot.robot
    arm = snapshot.arm(placement.goal.arm)
    trajectory = placement.trajectory
    chosen = np.linspace(0, len(trajectory.times) - 1, min(60, len(trajectory.times)))
    q = np.array(snapshot.q_start)
    path = []
    for row in chosen.round().astype(int):
        q[arm.q_index] = trajectory.positions[row]
        path.append(robot.link_pose(q, arm.tip_frame).translation)
    return np.array(path)
