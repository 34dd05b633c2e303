"""The node's reports about itself: `~/status` and `/diagnostics`."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import Placement
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.outputs.publishing import Outputs
from placement_planner_ros.ros.parameters.server import ParameterServer
from placement_planner_ros.ros.run.validity import moved, outdated
from placement_planner_ros.ros.run.warmth import Warmth
from placement_planner_ros.ros.run.watch import NOT_LOOKED_AT, Watch
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
_ARRIVE = "arrive"
"""Said of inputs that do."""
_CARRIED_OUT = "it has been carried out"
_LEVEL = {
    State.FAILED: DiagnosticStatus.ERROR,
    State.EXHAUSTED: DiagnosticStatus.WARN,
    State.ROBOT_MOVED: DiagnosticStatus.WARN,
}


class Reporter:
    """Publishes status and diagnostics, and watches whether the best placement still holds.

    Args:
        warm: whether what a search needs is compiled.
        on_error: told what nobody expected.
    """

    def __init__(
        self,
        node: Node,
        outputs: Outputs,
        inputs: Inputs,
        parameters: ParameterServer,
        warm: Warmth,
        on_error: Callable[[Exception], None],
    ) -> None:
        self._warm = warm
        self._outputs = outputs
        self._inputs = inputs
        self._parameters = parameters
        self._lock = threading.Lock()
        self._saying = threading.Lock()
        self._run: Run | None = None
        self._left = ""
        self._disagreements = ""
        self._reported: tuple[State, str, str, dict[str, str]] | None = None
        self._reported_at = -math.inf
        self._closed = False
        self._watch = Watch(inputs.clouds, self.report, on_error)
        every(node, REFRESH_PERIOD, self._refresh)
        every(node, 1.0, self._diagnose)
        self.report()

    def follow(self, run: Run) -> None:
        """From now on report on this run."""
        self._watch.follow(run.snapshot)
        with self._lock:
            self._run, self._left, self._disagreements = run, "", ""
        self.report()

    def prepared(self, run: Run, environment: Environment) -> None:
        """The run has begun to search in this environment."""
        self._watch.planned_in(run.snapshot, environment)
        self._disagreements = "; ".join(map(str, environment.disagreements))
        self.report()

    def placed(self, run: Run, placement: Placement) -> None:
        """The run has found a better placement."""
        self._watch.placed(run.snapshot, placement)

    def environment_changed(self) -> None:
        """What is known of the environment was changed by command."""
        self._watch.look_again()
        self.report()

    def left_start(self, run: Run) -> str:
        """In words, where the robot is further from where the run began than its start_tolerance;
        '' where it is not."""
        with self._lock:  # or what another thread has seen since would be forgotten
            left = moved(run.snapshot, self._inputs)
            news = self._run is run and self._left != left
            if news:
                self._left = left
        if news:
            self.report()
        return left

    def report(self) -> None:
        """Publish the status as it is now."""
        with self._saying:  # what was true last is said last
            run = self._run
            # The state first: what ended a run is then seen in all that is read after it.
            state = State.IDLE if run is None else run.state
            found = (0, None) if run is None else run.found
            why_not = self._why_invalid(run, found[1])
            warm, read = self._warm.shown, self._read()
            values: dict[str, object] = {"run": 0, "state": state, "code": "OK", "solutions": 0}
            if run is None:
                message = self._waiting(warm, read["inputs"])
            else:
                values |= _found(run, *found)
                message = _words(run, *found, why_not)
            values["best_valid"] = str(not why_not).lower()
            values["best_invalid_reason"] = why_not
            values["best_valid_known"] = str(why_not != NOT_LOOKED_AT).lower()
            if run is not None:
                values |= _tried(run)
            if self._disagreements:
                values["clouds_disagree"] = self._disagreements
            values["placed"] = " ".join(map(str, self._inputs.clouds.placed))
            values["warm"] = warm
            if warm == "failed":
                values["warm_failed_reason"] = self._warm.failure
            values |= read
            if self._closed:
                return
            self._reported = (state, why_not, warm, read)
            self._reported_at = time.monotonic()
            self._outputs.status(_LEVEL.get(state, DiagnosticStatus.OK), message, values)

    def close(self) -> None:
        """Publish nothing more; a worker that hangs may come back when the node is gone."""
        self._watch.close()
        with self._saying:
            self._closed = True

    @property
    def busy(self) -> bool:
        """Whether a thread of its own is still at work."""
        return self._watch.busy

    def _waiting(self, warm: str, inputs: str) -> str:
        """What the node does before the first run, and what it lacks."""
        words = _WAITING[warm]
        if warm == "false" and self._warm.progress:
            words = f"{self._warm.progress}; a start now takes longer"
        return words if inputs == _ARRIVE else f"{words}; {inputs}"

    def _read(self) -> dict[str, str]:
        robot = self._inputs.robot
        read: dict[str, str] = {
            "robot": robot.state,
            "object": self._inputs.object.state,
            "known_objects": str(len(self._inputs.known)),
            "inputs": self._arriving(time.monotonic()),
        }
        told = {
            "object_assumed": self._inputs.object.assumed,
            "object_progress": self._inputs.object.progress,
            "robot_progress": robot.progress,
            "warm_progress": self._warm.progress,
        }
        return read | {name: words for name, words in told.items() if words}

    def _arriving(self, now: float) -> str:
        """Whether there are joint states and clouds to start with, in words."""
        lacking = []
        if self._inputs.joints.age(now) > self._parameters.current["joint_state_timeout"]:
            lacking.append("joint states")
        if not self._inputs.clouds.ages(now) and not len(self._inputs.known):
            lacking.append("clouds")
        return f"no recent {', '.join(lacking)}" if lacking else _ARRIVE

    def _why_invalid(self, run: Run | None, best: Placement | None) -> str:
        """Why the best placement of a run cannot be carried out; '' where it can."""
        if run is None or best is None:
            return "there is no placement"
        if run.confirmed:
            return _CARRIED_OUT
        if self._left:
            return self._left
        return outdated(run.snapshot, self._inputs) or self._watch.blocked(best)

    def _refresh(self) -> None:
        run = self._run
        state = State.IDLE if run is None else run.state
        period = STATUS_PERIOD
        self._outputs.draw()
        if run is not None:
            self.left_start(run)
        why_not = self._why_invalid(run, None if run is None else run.best)
        if why_not == NOT_LOOKED_AT and self._reported is not None:
            # What was said last is of the placement before, and still so; the watch says the rest,
            # within a moment.
            why_not, period = self._reported[1], 2.0 * STATUS_PERIOD
        due = time.monotonic() - self._reported_at >= period
        now = (state, why_not, self._warm.shown, self._read())
        if (due and state is State.SEARCHING) or self._reported != now:
            self.report()

    def _diagnose(self) -> None:
        now = time.monotonic()
        joint_age = self._inputs.joints.age(now)
        ages = self._inputs.clouds.ages(now)
        values: dict[str, object] = {
            "state": State.IDLE if self._run is None else self._run.state,
            "joint_state_age": _seconds(joint_age),
        }
        values |= {f"cloud_age {topic}": _seconds(age) for topic, age in ages.items()}
        timeout = self._parameters.current["joint_state_timeout"]
        refused = self._inputs.joints.refused(now, timeout)
        if refused:
            values["joint_states_refused"] = refused
        arriving = self._arriving(now)
        well = arriving == _ARRIVE and not refused
        level = DiagnosticStatus.OK if well else DiagnosticStatus.WARN
        message = f"inputs {arriving}" if arriving == _ARRIVE else arriving
        if refused:
            message += "; some joint values are refused"
        self._outputs.diagnostics(level, message, values)


def _words(run: Run, solutions: int, best: Placement | None, why_not: str) -> str:
    """Where the run is and what it has found, in a line."""
    if best is None:
        if not run.active:
            return run.summary()
        samples = "" if run.planner is None else f", {run.planner.statistics.samples:,} samples"
        return f"{run.state} for {run.elapsed:.0f} s{samples}, no solution yet"
    noun = "solution" if solutions == 1 else f"{solutions} solutions, the best"
    first = f"{run.state} for {run.elapsed:.0f} s" if run.active else str(run.state)
    words = f"{first}: {noun} {best.objective:.4g} by arm {best.goal.arm}"
    if run.reason:
        words += f"; ended because {run.reason}"
    if run.confirmed:
        return f"{words}; {_CARRIED_OUT}"
    return f"{words}; not to be carried out: {why_not}" if why_not else words


def _found(run: Run, solutions: int, best: Placement | None) -> dict[str, object]:
    values: dict[str, object] = {"run": run.number, "code": run.code, "solutions": solutions}
    if best is not None:
        values["objective"] = float(best.objective)
    values["why"] = run.why
    return values


def _tried(run: Run) -> dict[str, object]:
    if run.planner is None:
        return {}
    statistics = run.planner.statistics
    values: dict[str, object] = {"samples": statistics.samples}
    values |= {f"rejected_{name}": n for name, n in statistics.rejected.items()}
    for face, rejected in statistics.rejected_by_face.items():
        values[f"rejected.face_{face}"] = _counts(rejected)
    for arm, rejected in statistics.rejected_by_arm.items():
        values[f"rejected.{arm}"] = _counts(rejected)
    return values


def _counts(rejected: dict[str, int]) -> str:
    return " ".join(f"{name}={number}" for name, number in rejected.items())


def _seconds(age: float) -> str:
    return "never" if age == float("inf") else f"{age:.2f} s"
