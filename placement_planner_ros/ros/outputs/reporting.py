"""Happenings of runs, passed on: results, `~/status`, `/diagnostics` and lines of the log."""

from __future__ import annotations

import math
import threading
import time
from functools import partial

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from placement_planner_ros.core.errors import listed
from placement_planner_ros.core.planner import PlacementPlanner
from placement_planner_ros.core.types import Placement
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.log import Log
from placement_planner_ros.ros.outputs.publishing import STATUS_PERIOD_S, Outputs
from placement_planner_ros.ros.parameters.server import ParameterServer
from placement_planner_ros.ros.patience import LOOK_S
from placement_planner_ros.ros.run.surroundings import environment_notes
from placement_planner_ros.ros.run.validity import moved_from_start, outdated_inputs
from placement_planner_ros.ros.run.watch import NOT_LOOKED_AT, Watch
from placement_planner_ros.ros.run.worker import Run, State, Warmth
from placement_planner_ros.ros.timers import every

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
    """Publishes, reports and logs a run's progress, and watches whether its best placement holds.

    The `RunObserver` of runs, in their worker threads.

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
        log: Log,
    ) -> None:
        self._warm = warm
        self._outputs = outputs
        self._inputs = inputs
        self._parameters = parameters
        self._log = log
        self._lock = threading.Lock()
        self._saying = threading.Lock()
        self._run: Run | None = None
        self._left = ""
        self._disagreements = ""
        self._reported: tuple[object, ...] = ()
        self._reported_at = -math.inf
        self._closed = False
        cannot = "the best placement cannot be held against newer clouds"
        self._watch = Watch(inputs.clouds, partial(log.fault, cannot))
        every(node, LOOK_S, self._refresh)
        every(node, 1.0, self._diagnose)
        self.report()

    def begun(self, run: Run) -> None:
        """A run is about to start, in the thread of who asked for it."""
        # else what is latched from the run before would pass for this one's
        self._outputs.clear(run.number, run.snapshot.frame)
        with self._lock:
            self._run, self._left, self._disagreements = run, "", ""
        self.report()

    def prepared(self, run: Run, planner: PlacementPlanner) -> None:
        """The run has begun to search."""
        notes = environment_notes(run.snapshot, planner.environment)
        if planner.unusable:
            notes.append(f"does without: {listed(planner.unusable, '; ')}")
        for note in notes:
            self._log.event(f"run {run.number}: {note}")
        self._outputs.environment(run.snapshot, planner.environment)
        self._disagreements = "; ".join(map(str, planner.environment.disagreements))
        self.report()

    def placed(self, run: Run, placement: Placement) -> None:
        """The run has found a better placement."""
        elapsed = run.elapsed
        self._outputs.solution(run.number, run.solutions, placement, elapsed, run.snapshot)
        self._log.event(
            f"run {run.number}: solution {run.solutions} after {elapsed:.2f} s, objective "
            f"{placement.objective:.4g}, arm {placement.goal.arm}"
        )
        self.report()

    def changed(self, run: Run) -> None:
        """The run is in another state."""
        if not run.active:
            tell = self._log.failure if run.state is State.FAILED else self._log.event
            tell(f"run {run.number} ended, {run.state}, code {run.code}: {run.summary()}")
        self.report()

    def failed(self, run: Run, error: BaseException) -> None:
        """The run ends over a fault, whose traceback is said here and nowhere else."""
        self._log.fault("a run met a fault", error)

    def environment_changed(self) -> None:
        """What is known of the environment was changed by command."""
        self._watch.look_again()
        self.report()

    def left_start(self, run: Run) -> str:
        """In words, where the robot is further from where the run began than its start_tolerance;
        '' where it is not."""
        with self._lock:  # or what another thread has seen since would be forgotten
            left = moved_from_start(run.snapshot, self._inputs)
            news = self._run is run and self._left != left
            if news:
                self._left = left
        if news:
            self.report()
        return left

    def report(self, only_news: bool = False) -> None:
        """Publish the status as it is now.

        Args:
            only_news: where nothing but counters is another, these at times and else nothing.
        """
        with self._saying:  # what was true last is said last
            run = self._run
            # The state first: what ended a run is then seen in all that is read after it.
            state = State.IDLE if run is None else run.state
            solutions, best = (0, None) if run is None else run.found
            # what keeps the best from being carried out, and what the inputs are doing
            why_not = self._why_invalid(run, best)
            warm, read = self._warm.shown, self._read()
            news, now = (state, solutions, why_not, warm, read), time.monotonic()
            due = state is State.SEARCHING and now - self._reported_at >= STATUS_PERIOD_S
            # a worker may report while the node is already being taken down
            if self._closed or (only_news and news == self._reported and not due):
                return
            self._reported, self._reported_at = news, now
            values: dict[str, object] = {"run": 0, "state": state, "code": "OK", "solutions": 0}
            message = self._waiting(warm, read["inputs"])
            if run is not None:
                values |= {"run": run.number, "code": run.code, "solutions": solutions}
                values |= {} if best is None else {"objective": float(best.objective)}
                values["why"] = run.why
                message = _state_words(run, solutions, best, why_not)
            values["best_valid"] = str(not why_not).lower()
            values["best_invalid_reason"] = why_not
            values["best_valid_known"] = str(why_not != NOT_LOOKED_AT).lower()
            values |= {} if run is None else _tried(run)
            values["placed"] = " ".join(map(str, self._inputs.known.placed))
            told = {"clouds_disagree": self._disagreements, "warm": warm}
            told["warm_failed_reason"] = self._warm.failure if warm == "failed" else ""
            values |= {name: words for name, words in told.items() if words} | read
            self._outputs.status(_LEVEL.get(state, DiagnosticStatus.OK), message, values)

    def close(self) -> None:
        """Publish nothing more; a worker that hangs may come back when the node is gone."""
        with self._saying:
            self._closed = True

    def _waiting(self, warm: str, inputs: str) -> str:
        """What the node does before the first run, and what it lacks."""
        words = _WAITING[warm]
        if warm == "false" and self._warm.progress:
            words = f"{self._warm.progress}; a start now takes longer"
        return words if inputs == _ARRIVE else f"{words}; {inputs}"

    def _read(self) -> dict[str, str]:
        robot, held = self._inputs.robot, self._inputs.object
        return {
            "robot": robot.state,
            "object": held.state,
            "known_objects": str(len(self._inputs.known)),
            "inputs": self._arriving(time.monotonic()),
        } | ({"warm_progress": self._warm.progress} if self._warm.progress else {})

    def _arriving(self, now: float) -> str:
        """Whether there are joint states and clouds to start with, in words."""
        lacking = []
        if self._inputs.joints.age(now) > self._parameters.current["joint_state_timeout"]:
            lacking.append("joint states")
        # with known objects a run can start without any cloud
        if not self._inputs.clouds.ages(now) and not len(self._inputs.known):
            lacking.append("clouds")
        return f"no recent {', '.join(lacking)}" if lacking else _ARRIVE

    def _why_invalid(self, run: Run | None, best: Placement | None) -> str:
        """Why the best placement of a run cannot be carried out; '' where it can."""
        if run is None or best is None:
            return "there is no placement"
        if run.confirmed:
            return _CARRIED_OUT
        # newer clouds come last, as all the rest is told at a glance
        outdated = self._left or outdated_inputs(run.snapshot, self._inputs)
        return outdated or self._watch.blocked(run.snapshot, best)

    def _refresh(self) -> None:
        run = self._run
        # put off until now, so that the search did not wait for it
        self._outputs.draw()
        if run is not None:
            self.left_start(run)
            best, planner = run.best, run.planner
            if best is not None and planner is not None and not run.confirmed:
                self._watch.look(run.snapshot, planner.environment, best)
        self.report(only_news=True)

    def _diagnose(self) -> None:
        now, joints = time.monotonic(), self._inputs.joints
        ages = {"joint_state_age": joints.age(now)}
        ages |= {f"cloud_age {t}": age for t, age in self._inputs.clouds.ages(now).items()}
        values: dict[str, object] = {"state": State.IDLE if self._run is None else self._run.state}
        values |= {
            name: "never" if math.isinf(age) else f"{age:.2f} s" for name, age in ages.items()
        }
        arriving = self._arriving(now)
        message = f"inputs {arriving}" if arriving == _ARRIVE else arriving
        level = DiagnosticStatus.OK if arriving == _ARRIVE else DiagnosticStatus.WARN
        self._outputs.diagnostics(level, message, values)


def _state_words(run: Run, solutions: int, best: Placement | None, why_not: str) -> str:
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


def _tried(run: Run) -> dict[str, object]:
    """What was tried, and which constraint rejected how many."""
    if run.planner is None:
        return {}
    statistics = run.planner.statistics
    return {
        "samples": statistics.samples,
        **({} if statistics.gap is None else {"gap": statistics.gap}),
        **{f"rejected_{name}": count for name, count in statistics.rejected.items()},
    }
