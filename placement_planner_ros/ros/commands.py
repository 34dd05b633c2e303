"""What the services do: start, stop, confirm and clear, one run at a time."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from rclpy.parameter import Parameter

from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.outputs.announcer import Announcer
from placement_planner_ros.ros.outputs.answers import Answer, answer, refusal
from placement_planner_ros.ros.parameters.server import ParameterServer
from placement_planner_ros.ros.run.planning import Prepare
from placement_planner_ros.ros.run.start_checks import take_snapshot
from placement_planner_ros.ros.run.surroundings import sight_notes
from placement_planner_ros.ros.run.worker import Run, State

STOP_PATIENCE = 1.0
"""Seconds that stop waits for the worker before it answers STOPPING."""


class Commands:
    """Begins and ends runs. Safe to use from several threads.

    Args:
        prepare: makes the planner of a run.
        announcer: tells the world of each run.
        warm: set once everything a search needs is compiled.

    Attributes:
        run: the last one; None before the first.
    """

    def __init__(
        self,
        inputs: Inputs,
        parameters: ParameterServer,
        prepare: Prepare,
        announcer: Announcer,
        warm: threading.Event,
    ) -> None:
        self.run: Run | None = None
        self._inputs = inputs
        self._parameters = parameters
        self._prepare = prepare
        self._announcer = announcer
        self._warm = warm
        self._lock = threading.Lock()

    @property
    def busy(self) -> bool:
        """Whether a worker is still at work, be it told to end or not."""
        return self.run is not None and self.run.active

    def start(self, changes: Sequence[Parameter] = ()) -> Answer:
        """Check all inputs and begin a run, with some parameters changed for it alone."""
        with self._lock:
            busy = self._busy()
            if busy is not None:
                return busy
            faults = self._parameters.faults(changes)
            if faults:
                return refusal(faults)
            parameters = self._parameters.with_changes(changes)
            snapshot = take_snapshot(self._inputs, parameters, [p.name for p in changes])
            if isinstance(snapshot, list):
                return refusal(snapshot)
            number = 1 if self.run is None else self.run.number + 1
            self.run = Run(number, snapshot, self._prepare, self._announcer, self._warm)
            self._announcer.begun(self.run)
            self.run.start()
        words = f"planning for {' or '.join(arm.name for arm in snapshot.arms)}"
        notes = [
            *snapshot.body.warnings,
            *snapshot.robot.limit_violations(snapshot.q_start),
            *sight_notes(snapshot),
        ]
        return answer("OK", "\n".join([words, *notes]), run=number)

    def stop(self) -> Answer:
        """End the run; answers once its worker is idle."""
        run = self.run
        if run is None:
            return answer("NOT_RUNNING", "no run was started", success=True)
        if not run.active:
            return _outcome("NOT_RUNNING", run)
        run.end(State.STOPPED)
        if not run.wait(STOP_PATIENCE):
            return answer(
                "STOPPING",
                f"the worker has not ended within {STOP_PATIENCE:g} s; it publishes nothing more",
                run=run.number,
            )
        return _outcome("OK", run)

    def stop_with(self, parameters: Sequence[Parameter]) -> Answer:
        """End one run only."""
        wanted = {p.name: p.value for p in parameters}
        if set(wanted) != {"run"} or type(wanted["run"]) is not int:
            return answer("BAD_PARAMETER", "give one integer parameter, run: the run to stop")
        run = self.run
        if run is None or run.number != wanted["run"]:
            known = "no run was started" if run is None else f"the last run is {run.number}"
            return answer("WRONG_RUN", known, run=wanted["run"])
        return self.stop()

    def confirm_placed(self) -> Answer:
        """The best placement was carried out: the object is part of the environment now."""
        with self._lock:
            busy = self._busy()
            if busy is not None:
                return busy
            run = self.run
            if run is None or run.best is None:
                return answer("NO_OBJECT", "there is no placement that could have been carried out")
            if not run.confirmed:
                self._inputs.confirm(run.best, run.snapshot.body)
            run.confirmed = True
        self._announcer.confirmed()
        return answer("OK", "the object is obstacle and support now", run=run.number)

    def clear_environment(self) -> Answer:
        """Forget accumulated points and confirmed objects."""
        with self._lock:
            busy = self._busy()
            if busy is not None:
                return busy
            self._inputs.clouds.clear()
        return answer("OK", "accumulated points and confirmed objects are forgotten")

    def close(self) -> None:
        """End the run, if there is one."""
        run = self.run
        if run is not None and run.active:
            run.end(State.STOPPED)
            run.wait(STOP_PATIENCE)

    def _busy(self) -> Answer | None:
        """The refusal of whatever needs an idle planner."""
        run = self.run
        if run is None or not run.active:
            return None
        if run.state is State.STOPPING:
            return answer("STOPPING", "the last run has not ended yet", run=run.number)
        return answer("ALREADY_RUNNING", f"state {run.state}", run=run.number)


def _outcome(code: str, run: Run) -> Answer:
    values: dict[str, object] = {"run": run.number, "solution": run.solutions}
    if run.best is not None:
        values["objective"] = float(run.best.objective)
    return answer(code, f"{run.state}: {run.summary()}", success=True, **values)
