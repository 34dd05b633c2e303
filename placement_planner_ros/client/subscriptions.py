"""Subscriptions of a client: the node's status and the parts of its newest solutions."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory

from placement_planner_ros.client.solution import Solution, solution_of
from placement_planner_ros.client.status import Status, Validity
from placement_planner_ros.client.waiting import News
from placement_planner_ros.ros.qos import latched

KEPT = 20
"""Messages of each topic that are kept, the newest ones."""

_PARTS = {
    "trajectory": JointTrajectory,
    "retreat_trajectory": JointTrajectory,
    "placement_pose": PoseStamped,
    "solution": DiagnosticArray,
}
"""Topics of a solution's parts."""


class Subscriptions:
    """Listens to one node. Safe to use from several threads.

    The parts of a solution come on topics of their own, of which any may lag behind, so that a
    solution is there once all are. What is not of the run that is asked for counts for nothing.

    Args:
        planner: the planning node's name.
        news: told of whatever comes.
    """

    def __init__(self, node: Node, planner: str, group: CallbackGroup, news: News) -> None:
        self._lock = threading.Lock()
        self._news = news
        self._status: Status | None = None
        self._parts: dict[str, dict[Any, Any]] = {topic: {} for topic in _PARTS}
        self._node = node

        takes: dict[str, tuple[type, Callable[[Any], None]]] = {
            topic: (kind, partial(self._keep, topic)) for topic, kind in _PARTS.items()
        }
        takes["status"] = DiagnosticStatus, self._take_status
        qos = latched(KEPT)
        self._subscriptions = [
            node.create_subscription(kind, f"{planner}/{topic}", take, qos, callback_group=group)
            for topic, (kind, take) in takes.items()
        ]

    def close(self) -> None:
        """Listen no more."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    @property
    def status(self) -> Status | None:
        """The newest; None before the first."""
        return self._status

    def solution(self, run: int, number: int | None = None) -> Solution | None:
        """The run's last solution of which all has come, or the one of that number, where all of it
        has come and is still kept; None where there is none."""
        with self._lock:
            kept = sorted((n for r, n in self._parts["solution"] if r == run), reverse=True)
            numbers = kept if number is None else [number]
            return next(filter(None, (self._solution(run, each) for each in numbers)), None)

    def validity(self, run: int, number: int) -> Validity:
        """Whether that solution can still be carried out, by the newest status."""
        status = self._status
        # the status may lag behind the solution
        if status is None or (status.run, status.solutions) < (run, number):
            return Validity("the node has not said yet whether it holds", known=False)
        if (status.run, status.solutions) != (run, number):
            last = f"the node's last run is {status.run} and its last solution {status.solutions}"
            return Validity(f"{last}; it watches no other")
        return status.validity

    def _solution(self, run: int, number: int) -> Solution | None:
        """With the lock held."""
        if (manifest := self._parts["solution"].get((run, number))) is None:
            return None
        # each part by what it carries: the key, or the stamp of its manifest
        key, parts = f"{run}/{number}", self._parts
        pose = parts["placement_pose"].get(_stamp_of(manifest))
        trajectory = parts["trajectory"].get(key)
        retreat = parts["retreat_trajectory"].get(key)
        if pose is None or trajectory is None or retreat is None:
            return None
        return solution_of(manifest, pose, trajectory, retreat, self.validity(run, number))

    def _take_status(self, message: DiagnosticStatus) -> None:
        self._status = Status.of(message)
        self._news.tell()

    def _keep(self, topic: str, message: Any) -> None:
        if topic == "solution":
            values = {pair.key: pair.value for pair in message.status[0].values}
            key: Any = (int(values["run"]), int(values["solution"]))
            if key[1] == 0:  # it withdraws those of the run before
                return
        else:
            # trajectories carry the key as their frame, a pose has the stamp of its manifest
            key = _stamp_of(message) if topic == "placement_pose" else message.header.frame_id
        kept = self._parts[topic]
        with self._lock:
            kept[key] = message
            # a dict keeps the order in which keys came, so the first is the oldest
            while len(kept) > KEPT:
                del kept[next(iter(kept))]
        self._news.tell()


def _stamp_of(message: Any) -> tuple[int, int]:
    return message.header.stamp.sec, message.header.stamp.nanosec
