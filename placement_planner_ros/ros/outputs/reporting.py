"""What the node says about itself: `~/status` and `/diagnostics`."""

from __future__ import annotations

import math
import threading
import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from placement_planner_ros.core.errors import JointStateError
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.outputs.publishing import Outputs
from placement_planner_ros.ros.parameters.server import ParameterServer
from placement_planner_ros.ros.run.validity import KnownSpace, blocked_by
from placement_planner_ros.ros.run.warmth import Warmth
from placement_planner_ros.ros.run.worker import Run, State
from placement_planner_ros.ros.timers import every

STATUS_PERIOD = 0.5
"""Least seconds between status messages while searching, unless the state changes."""

REFRESH_PERIOD = 0.1
"""Seconds between looks at whether there is something to say."""

_WAITING = {
    "true": "waiting for start",
    "false": "compiling; a start now takes longer",
    "failed": "warming up failed; a run compiles what it needs as it goes",
}
_LEVEL = {
    State.FAILED: DiagnosticStatus.ERROR,
    State.EXHAUSTED: DiagnosticStatus.WARN,
    State.ROBOT_MOVED: DiagnosticStatus.WARN,
}


class Reporter:
    """Publishes status and diagnostics, and watches whether the best placement still holds.

    Args:
        warm: whether what a search needs is compiled.
    """

    def __init__(
        self,
        node: Node,
        outputs: Outputs,
        inputs: Inputs,
        parameters: ParameterServer,
        warm: Warmth,
    ) -> None:
        self._warm = warm
        self._outputs = outputs
        self._inputs = inputs
        self._parameters = parameters
        self._lock = threading.Lock()
        self._run: Run | None = None
        self._obstacles: ObstacleSet | None = None
        self._known: KnownSpace | None = None
        self._checked: tuple[int, int] = (0, 0)
        self._blocked = ""
        self._left = False
        self._reported: tuple[State, str, str, dict[str, str]] | None = None
        self._reported_at = -math.inf
        self._closed = False
        every(node, REFRESH_PERIOD, self._refresh)
        every(node, 1.0, self._diagnose)
        self.report()

    def follow(self, run: Run) -> None:
        """From now on report on this run."""
        with self._lock:
            self._run = run
            self._obstacles, self._known = None, None
            self._blocked, self._left = "", False
            self._checked = (0, self._inputs.clouds.changes)
        self.report()

    def environment_known(self, run: Run, environment: Environment) -> None:
        """What the run plans in."""
        with self._lock:
            if self._run is run:
                self._obstacles = environment.obstacles

    def has_left_start(self, run: Run) -> bool:
        """Whether the robot is further from q_0 than the run's start_tolerance."""
        q = self._configuration(run)
        if q is None:
            return False
        tolerance = run.snapshot.parameters["start_tolerance"]
        left = bool(np.abs(q - run.snapshot.q_start).max() > tolerance)
        with self._lock:
            if self._run is run:
                self._left = left
        return left

    def report(self) -> None:
        """Publish the status as it is now."""
        run, why_not = self._run, self._why_invalid()
        state = State.IDLE if run is None else run.state
        values: dict[str, object] = {"run": 0, "state": state, "code": "OK", "solutions": 0}
        warm = self._warm.shown
        message = _WAITING[warm]
        values["placed"] = " ".join(map(str, self._inputs.clouds.placed))
        values["warm"] = warm
        if warm == "failed":
            values["warm_failed_reason"] = self._warm.failure
        values |= self._read()
        values["best_valid"] = str(not why_not).lower()
        values["best_invalid_reason"] = why_not
        if run is not None:
            values |= _progress(run)
            message = run.reason or str(state)
            if run.solutions == 0 and not run.active:
                message = run.summary()
        with self._lock:
            if self._closed:
                return
            self._reported = (state, why_not, warm, self._read())
            self._reported_at = time.monotonic()
            self._outputs.status(_LEVEL.get(state, DiagnosticStatus.OK), message, values)

    def close(self) -> None:
        """Publish nothing more; a worker that hangs may come back when the node is gone."""
        with self._lock:
            self._closed = True

    def _read(self) -> dict[str, str]:
        return {"robot": self._inputs.robot.state, "object": self._inputs.object.state}

    def _why_invalid(self) -> str:
        with self._lock:
            if self._run is None or self._run.best is None:
                return "there is no placement"
            if self._run.confirmed:
                return "it has been carried out"
            return "the robot has left q_0" if self._left else self._blocked

    def _refresh(self) -> None:
        run = self._run
        state = State.IDLE if run is None else run.state
        due = time.monotonic() - self._reported_at >= STATUS_PERIOD
        self._outputs.draw()
        if run is not None:
            self.has_left_start(run)
            if due:
                self._check_clouds(run)
        now = (state, self._why_invalid(), self._warm.shown, self._read())
        if (due and state is State.SEARCHING) or self._reported != now:
            self.report()

    def _check_clouds(self, run: Run) -> None:
        """Look whether clouds newer than the run's cut through its best placement."""
        with self._lock:
            obstacles, known, best = self._obstacles, self._known, run.best
            now = (run.solutions, self._inputs.clouds.changes)
            if obstacles is None or best is None or now == self._checked or self._left:
                return
            self._checked = now
        q = self._configuration(run)
        clouds = self._inputs.clouds.latest_points()
        if q is None or not clouds:
            return
        if known is None:
            known = KnownSpace(obstacles)
            with self._lock:
                if self._obstacles is obstacles:
                    self._known = known
        blocked = blocked_by(np.vstack(clouds), known, best, run.snapshot, q)
        with self._lock:
            if self._run is run:
                self._blocked = blocked

    def _configuration(self, run: Run) -> Array | None:
        try:
            return run.snapshot.robot.configuration(self._inputs.joints.positions())
        except JointStateError:
            return None

    def _diagnose(self) -> None:
        now = time.monotonic()
        joint_age = self._inputs.joints.age(now)
        ages = self._inputs.clouds.ages(now)
        values: dict[str, object] = {
            "state": State.IDLE if self._run is None else self._run.state,
            "joint_state_age": _seconds(joint_age),
        }
        values |= {f"cloud_age {topic}": _seconds(age) for topic, age in ages.items()}
        lacking = []
        if joint_age > self._parameters.current["joint_state_timeout"]:
            lacking.append("joint states")
        if not ages:
            lacking.append("clouds")
        level = DiagnosticStatus.WARN if lacking else DiagnosticStatus.OK
        message = f"no recent {', '.join(lacking)}" if lacking else "inputs arrive"
        self._outputs.diagnostics(level, message, values)


def _progress(run: Run) -> dict[str, object]:
    values: dict[str, object] = {"run": run.number, "code": run.code, "solutions": run.solutions}
    if run.best is not None:
        values["objective"] = float(run.best.objective)
    if run.planner is not None:
        statistics = run.planner.statistics
        values["samples"] = statistics.samples
        values |= {f"rejected_{name}": n for name, n in statistics.rejected.items()}
        for face, rejected in statistics.rejected_by_face.items():
            values[f"rejected.rest_{face}"] = _counts(rejected)
        for arm, rejected in statistics.rejected_by_arm.items():
            values[f"rejected.{arm}"] = _counts(rejected)
    values["why"] = run.why
    return values


def _counts(rejected: dict[str, int]) -> str:
    return " ".join(f"{name}={number}" for name, number in rejected.items())


def _seconds(age: float) -> str:
    return "never" if age == float("inf") else f"{age:.2f} s"
