"""The real node beside three clouds of 300,000 points at 10 Hz, as JSON lines on standard output.

How long start and stop take to answer, how many samples of a search the clouds cost, and how long
it takes from a cloud that cuts through the best placement until `~/status` says so.
`python -m benchmarks speed --rows load` starts this as a process of its own.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Bool, Header
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from benchmarks.node.cloud_load import POINTS, TOPICS, many_points
from benchmarks.node.node_speed import (
    NAMESPACE,
    OBJECT,
    SCENE,
    NodeCaller,
    NodeSpeedError,
    measure_processes,
    node_command,
    report_stop,
    tell_entry,
    wait_until_ready,
)
from placement_planner_ros.client import Status
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.ros.tools.scene_publisher import FRAME, RELIABLE
from placement_planner_ros.scenes.yumi import TIP_FRAMES, load_yumi, start_configuration

_SETTLED = 1.0
"""Seconds after which the clouds come, or come no more."""
_TURN = 3.0
"""Seconds that clouds come, or do not, while samples are counted."""
_SEARCH = 48.0
"""Seconds of a search with clouds in turns."""
_PAUSE = 0.15
"""Seconds between calls."""
_FAR = 0.2
"""m from where the hand starts, that a cloud cuts through its path at least."""
_BLOCK = 0.02
"""m, standard deviation of the points that cut through the path."""
_SHARE = 0.01
"""Of a cloud's points, that cut through the path."""
_TOLD_WITHIN = 5.0


class LoadCaller(NodeCaller):
    """Also publishes clouds of its own, and turns those of `cloud_load` on and off."""

    def __init__(self) -> None:
        super().__init__()
        self.counts: list[tuple[float, int]] = []
        self.valid = False
        self.changed = 0.0
        self.trajectory = JointTrajectory()
        self.cloud = self.create_publisher(PointCloud2, "points", RELIABLE)
        self._load = self.create_publisher(Bool, "load", LATCHED)
        planner = "placement_planner"
        self.create_subscription(JointTrajectory, f"{planner}/trajectory", self._on_path, LATCHED)
        self.ages: list[float] = []
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def load(self, on: bool) -> None:
        """Have the three clouds published, or not."""
        self._load.publish(Bool(data=on))

    def _on_status(self, message: DiagnosticStatus) -> None:
        now = time.perf_counter()
        super()._on_status(message)
        status = Status.of(message)
        self.counts.append((now, int(status.values.get("samples", 0))))
        valid = bool(status.validity)
        if valid != self.valid:
            self.valid, self.changed = valid, now

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        values = {v.key: v.value for v in message.status[0].values}
        known = [values.get(f"cloud_age {topic}", "never") for topic in TOPICS]
        if message.status[0].name.endswith("placement_planner") and "never" not in known:
            self.ages.append(max(float(age.removesuffix(" s")) for age in known))

    def _on_path(self, message: JointTrajectory) -> None:
        if message.points:
            self.trajectory = message


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=100, help="starts and stops")
    parser.add_argument("--searches", type=int, default=2, help="of 48 s, clouds in turns")
    parser.add_argument("--alarms", type=int, default=200, help="clouds that cut through the best")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    # The three cameras are silent for longer than their clouds would do.
    topics = ["-p", f"cloud_topics:=[{','.join(TOPICS)}]", "-p", "cloud.max_age:=0.0"]
    load = ["-m", "benchmarks.node.cloud_load", SCENE, OBJECT]
    load += ["--ros-args", "-r", f"__ns:={NAMESPACE}", "--log-level", "warn"]

    def measure(processes: Sequence[subprocess.Popen[bytes]]) -> None:
        caller = LoadCaller()
        wait_until_ready(caller, processes[0])
        rng = np.random.default_rng(options.seed)
        _tell_calls(caller, options.calls, rng)
        _tell_samples(caller, options.searches)
        _tell_alarms(caller, options.alarms, rng)

    return measure_processes([node_command() + topics, load], measure)


def _tell_calls(caller: LoadCaller, number: int, rng: np.random.Generator) -> None:
    """Starts and stops beside the clouds, stopped anywhere in the first half second."""
    caller.load(True)
    caller.spin(2.0)
    for _ in range(number):
        _, _, seconds = caller.begin(int(rng.integers(1000)))
        tell_entry("load", kind="start", seconds=seconds)
        caller.spin(float(rng.uniform(0.0, 0.5)))
        report_stop(caller, "load")
        caller.spin(_PAUSE)


def _tell_samples(caller: LoadCaller, searches: int) -> None:
    """Samples per second while clouds come and while none do, in turns within one search."""
    for number in range(searches):
        caller.load(False)
        caller.spin(_SETTLED)
        begin_search(caller, number)
        rates: dict[bool, list[float]] = {False: [], True: []}
        end = time.perf_counter() + _SEARCH
        clouds = bool(number % 2)
        while time.perf_counter() < end:
            caller.load(clouds)
            caller.spin(_SETTLED)
            caller.counts.clear()
            caller.ages.clear()
            caller.spin(_TURN)
            for age in caller.ages if clouds else ():
                tell_entry("load", kind="age", seconds=age)
            (begun, before), (ended, after) = caller.counts[0], caller.counts[-1]
            rates[clouds].append((after - before) / (ended - begun))
            clouds = not clouds
        caller.call(caller.stop, Trigger.Request())
        caller.wait(lambda: caller.state[1] == "stopped", 5.0)
        without, beside = (float(np.mean(rates[clouds])) for clouds in (False, True))
        tell_entry("load", kind="samples", without=without, beside=beside, turns=len(rates[True]))
    caller.load(False)


def _tell_alarms(caller: LoadCaller, number: int, rng: np.random.Generator) -> None:
    """Clouds that cut through the best placement, half of them during a search."""
    caller.load(False)
    points = many_points(SCENE, 99)
    clean = message_from_points(points, Header(frame_id=FRAME))
    robot = load_yumi()
    q_start = robot.configuration(start_configuration(OBJECT))
    done = 0
    while done < number:
        begin_search(caller, done)
        caller.spin(0.5)
        for searching in (True, False):
            if not searching:
                caller.call(caller.stop, Trigger.Request())
            for _ in range(10):
                if not caller.valid:
                    caller.cloud.publish(clean)
                    if not caller.wait(lambda: caller.valid, _TOLD_WITHIN):
                        raise NodeSpeedError("the best placement does not get valid again")
                caller.spin(float(rng.uniform(0.1, 0.3)))
                place = _on_the_way(robot, q_start, caller.trajectory, rng)
                if place is None:
                    continue
                cut = points.copy()
                rows = rng.choice(POINTS, int(POINTS * _SHARE), replace=False)
                cut[rows] = place + rng.normal(0.0, _BLOCK, (len(rows), 3))
                seconds = _seconds_to_alarm(caller, message_from_points(cut, clean.header))
                if seconds is not None:
                    done += 1
                    told = seconds < _TOLD_WITHIN
                    tell_entry(
                        "load", kind="alarm", seconds=seconds, searching=searching, told=told
                    )
        caller.cloud.publish(clean)
        caller.spin(0.3)


def begin_search(caller: LoadCaller, seed: int) -> None:
    """Start a run, and wait for its first placement.

    Raises:
        NodeSpeedError: there is none.
    """
    run, _, _ = caller.begin(seed)
    if not caller.wait(lambda: run in caller.first, 20.0):
        raise NodeSpeedError("no placement was found in 20 s")


def _seconds_to_alarm(caller: LoadCaller, message: PointCloud2) -> float | None:
    """From publishing a cloud until the best placement is told to be invalid; None where another
    one has become the best meanwhile, that the cloud need not cut through."""
    path, began = caller.trajectory, time.perf_counter()
    caller.cloud.publish(message)
    told = caller.wait(lambda: not caller.valid, _TOLD_WITHIN)
    if caller.trajectory is not path:
        return None
    return caller.changed - began if told else _TOLD_WITHIN


def _on_the_way(
    robot: Any, q_start: Array, trajectory: JointTrajectory, rng: np.random.Generator
) -> Array | None:
    """(3,) where the hand comes along far from where it starts; None where it does nowhere."""
    tip = TIP_FRAMES["left" if trajectory.joint_names[0].endswith("_l") else "right"]
    begin = robot.link_pose(q_start, tip).translation
    far = []
    for point in trajectory.points:
        values = dict(zip(trajectory.joint_names, point.positions, strict=True))
        place = robot.link_pose(robot.with_positions(q_start, values), tip).translation
        if np.linalg.norm(place - begin) > _FAR:
            far.append(place)
    return np.array(far[int(rng.integers(len(far)))]) if far else None


if __name__ == "__main__":
    sys.exit(main())
