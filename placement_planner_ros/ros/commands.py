"""The services' actions: start, stop, confirm and clear, one run at a time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Concatenate, ParamSpec

import pinocchio as pin
from rclpy.parameter import Parameter

from placement_planner_ros.core.errors import ParameterError, listed
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.wishes import checks as wish_checks
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.outputs.answers import ServiceAnswer, answer, refusal
from placement_planner_ros.ros.outputs.reporting import Reporter
from placement_planner_ros.ros.parameters.checks import poses_from_list
from placement_planner_ros.ros.parameters.server import ParameterServer
from placement_planner_ros.ros.parameters.spec import own_spec
from placement_planner_ros.ros.patience import STOP_PATIENCE_S
from placement_planner_ros.ros.run.preparation import Prepare
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.start_checks import start_notes, take_snapshot
from placement_planner_ros.ros.run.worker import Run, State, Warmth
from placement_planner_ros.ros.spinning import survive

Given = ParamSpec("Given")

STAND_IN = "the bundled YuMi, as no robot_description has come"
"""The robot in use where none was given."""
POSE = own_spec(
    "pose", "double[]", [], "seven numbers: x y z qx qy qz qw", wish_checks.check_pose_value
)
"""Where an object was measured, m."""


def _when_idle(
    command: Callable[Concatenate[Commands, Given], ServiceAnswer],
) -> Callable[Concatenate[Commands, Given], ServiceAnswer]:
    """A command that needs an idle planner: refused while a run is active, one at a time."""

    def act(self: Commands, *given: Given.args, **named: Given.kwargs) -> ServiceAnswer:
        # one command at a time, so that no other begins between the look and the action
        with self._lock:
            return self._busy() or command(self, *given, **named)

    return act


class Commands:
    """Begins and ends runs. Safe to use from several threads.

    Args:
        prepare: makes the planner of a run.
        environment_of: the environment of a run, where it is there already.
        reporter: tells the world of each run.
        warm: set once warming up is over.

    Attributes:
        run: the last one; None before the first.
    """

    def __init__(
        self,
        inputs: Inputs,
        parameters: ParameterServer,
        prepare: Prepare,
        environment_of: Callable[[Snapshot], Environment | None],
        reporter: Reporter,
        warm: Warmth,
    ) -> None:
        self.run: Run | None = None
        self._inputs = inputs
        self._parameters = parameters
        self._prepare = prepare
        self._environment_of = environment_of
        self._reporter = reporter
        self._warm = warm
        # Milliseconds of the wall clock: greater than any number given before, as no node answers
        # a thousand starts in a second, and exact where clients keep numbers as doubles.
        self._number = time.time_ns() // 1_000_000
        self._lock = threading.Lock()

    @property
    def busy(self) -> bool:
        """Whether a run has not ended yet, be it told to end or not."""
        run = self.run
        return run is not None and run.active

    @_when_idle
    def start(self, changes: Sequence[Parameter] = ()) -> ServiceAnswer:
        """Check all inputs and begin a run, with some parameters changed for it alone."""
        given = {p.name: p.value for p in changes}
        parameters = self._parameters.current.changed_or_faults(given)
        if isinstance(parameters, list):
            return refusal(parameters)
        # one consistent moment of all inputs, or every fault
        snapshot = take_snapshot(self._inputs, parameters, given)
        if isinstance(snapshot, list):
            return refusal(snapshot)
        # q_0 against limits, itself and, where they are there already, the clouds
        notes = start_notes(snapshot, self._environment_of(snapshot))
        self._number += 1
        run = Run(self._number, snapshot, self._prepare, self._reporter, self._warm)
        # known before it begins, so that a stop that comes at once finds it
        self.run = run

        def begin() -> bool:
            self._reporter.begun(run)
            run.start()
            return True

        if not survive(begin, run.fail):  # or it would count as active for ever
            return answer("INTERNAL", run.reason, run=run.number)
        words = f"planning for {' or '.join(arm.name for arm in snapshot.arms)}"
        if not self._inputs.robot.is_given:
            words += f" of {STAND_IN}"
        return answer("OK", listed([words, *notes], "\n"), run=run.number)

    start_with = start

    def stop(self) -> ServiceAnswer:
        """End the run; answers once it has ended."""
        # without the lock: a stop may come while another command is still being carried out
        if self.run is None:
            return answer("NOT_RUNNING", "no run was started", success=True)
        return _stop_run(self.run)

    def stop_with(self, parameters: Sequence[Parameter]) -> ServiceAnswer:
        """End one run only."""
        run = self._run_asked_for(_values(parameters, ("run",))["run"])
        return run if isinstance(run, ServiceAnswer) else _stop_run(run)

    @_when_idle
    def confirm_placed(self) -> ServiceAnswer:
        """The best placement was carried out: the object is part of the environment now."""
        run = self.run
        if run is None or run.best is None:
            return answer("NO_OBJECT", "there is no placement that could have been carried out")
        return self._confirm(run, run.solutions, None)

    @_when_idle
    def confirm_placed_with(self, parameters: Sequence[Parameter]) -> ServiceAnswer:
        """A placement of the last run was carried out, perhaps not quite where planned."""
        values = _values(parameters, ("run", "solution"), ("pose",))
        solution = values["solution"]
        pose = _measured_pose(values["pose"]) if "pose" in values else None
        # the placements of the last run are the only ones that are kept
        run = self._run_asked_for(values["run"])
        if isinstance(run, ServiceAnswer):
            return run
        # each one that was published may have been carried out, not only the best
        if solution not in run.poses:
            known = f"{min(run.poses)} to {run.solutions}" if run.poses else "none"
            raise ParameterError("solution", solution, f"run {run.number} has {known}")
        return self._confirm(run, solution, pose)

    @_when_idle
    def remove_placed(self, parameters: Sequence[Parameter]) -> ServiceAnswer:
        """What a run placed has been taken away."""
        wanted = _values(parameters, ("run",))["run"]
        # accumulated points of the object go with it, as near to it as the self-filter pads
        padding = self._parameters.current["self_filter.padding"]
        if not self._inputs.remove(wanted, padding):
            placed = listed([str(n) for n in self._inputs.known.placed]) or "none"
            words = f"nothing of that run stands; runs whose objects stand: {placed}"
            return answer("WRONG_RUN", words, run=wanted)
        self._reporter.environment_changed()
        return answer("OK", "the object is no part of the environment any more", run=wanted)

    @_when_idle
    def clear_environment(self) -> ServiceAnswer:
        """Forget accumulated points and confirmed objects."""
        self._inputs.clear()
        self._reporter.environment_changed()
        return answer("OK", "accumulated points and confirmed objects are forgotten")

    def close(self) -> None:
        """End the run, if there is one."""
        run = self.run
        if run is not None and run.active:
            run.end(State.STOPPED)
            run.wait(STOP_PATIENCE_S)

    def _busy(self) -> ServiceAnswer | None:
        """The refusal of whatever needs an idle planner."""
        run = self.run
        if run is None or not run.active:
            return None
        if run.state is State.STOPPING:
            return answer("STOPPING", "the last run has not ended yet", run=run.number)
        words = f"run {run.number} is {run.state}: wait for its end, or stop it (~/stop_with)"
        return answer("ALREADY_RUNNING", words, run=run.number)

    def _run_asked_for(self, wanted: int) -> Run | ServiceAnswer:
        """The last run where that is the one, or the refusal."""
        run = self.run
        if run is not None and run.number == wanted:
            return run
        known = "this node has begun no run; was it restarted since that run was?"
        if run is not None:
            known = f"the last run is {run.number}"
        return answer("WRONG_RUN", known, run=wanted)

    def _confirm(self, run: Run, solution: int, measured: pin.SE3 | None) -> ServiceAnswer:
        pose = run.poses[solution] if measured is None else measured
        self._inputs.confirm(run.number, run.snapshot.body, pose)
        run.confirmed = True
        self._reporter.environment_changed()
        return answer("OK", "the object is obstacle and support now", run=run.number)


def _stop_run(run: Run) -> ServiceAnswer:
    # told before the run is ended, which changes it
    code = "OK" if run.active else "NOT_RUNNING"
    run.end(State.STOPPED)
    # the worker looks for the stop between its steps, of which one may take a while
    if not run.wait(STOP_PATIENCE_S):
        words = f"the worker has not ended within {STOP_PATIENCE_S:g} s; it publishes nothing more"
        return answer("STOPPING", words, run=run.number)
    # read once it has ended, so that no solution comes after the answer
    values: dict[str, object] = {"run": run.number, "solution": run.solutions}
    if run.best is not None:
        values["objective"] = float(run.best.objective)
    words = listed([f"{run.state}: {run.summary()}", *filter(None, [run.details])], "\n")
    return answer(code, words, success=True, **values)


def _values(
    parameters: Sequence[Parameter], needed: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, Any]:
    """What a command was given, by name; what is needed are integers.

    Raises:
        ParameterError: something is missing, is none, or nobody knows it.
    """
    values = {p.name: p.value for p in parameters}
    # a name that nobody knows may be an optional one misspelt
    for name in values:
        if name not in (*needed, *optional):
            known = ", ".join((*needed, *optional))
            raise ParameterError(name, values[name], f"give {known} and nothing else")
    # the type itself is asked for, as to Python a bool is an integer
    for name in needed:
        if type(values.get(name)) is not int:
            raise ParameterError(name, values.get(name), f"give an integer parameter {name}")
    return values


def _measured_pose(value: object) -> pin.SE3:
    """A pose of x y z qx qy qz qw.

    Raises:
        ParameterError: it is none.
    """
    numbers = POSE.convert(value)
    if not isinstance(numbers, list) or not numbers:
        raise ParameterError("pose", value, f"give {POSE.meaning.text}")
    return poses_from_list("pose", [float(number) for number in numbers])[0]
