"""Passes what happens in a run on to publishers of results and of status."""

from __future__ import annotations

from placement_planner_ros.core.errors import listed
from placement_planner_ros.core.types import Placement
from placement_planner_ros.ros.log import Log
from placement_planner_ros.ros.outputs.publishing import Outputs
from placement_planner_ros.ros.outputs.reporting import Reporter
from placement_planner_ros.ros.run.planning import Prepared
from placement_planner_ros.ros.run.surroundings import sight_notes
from placement_planner_ros.ros.run.worker import Run, State


class Announcer:
    """Publishes, reports and logs a run's progress: its `RunObserver`, in its worker thread."""

    def __init__(self, outputs: Outputs, reporter: Reporter, log: Log) -> None:
        self._log = log
        self._outputs = outputs
        self._reporter = reporter

    def begun(self, run: Run) -> None:
        """A run is about to start, in the thread of who asked for it."""
        self._outputs.clear(run.number, run.snapshot.frame)
        self._reporter.follow(run)

    def failed(self, run: Run, error: BaseException) -> None:
        """The run ends over a fault, whose traceback is said here and nowhere else."""
        self._log.fault("a run met a fault", error)

    def prepared(self, run: Run, prepared: Prepared) -> None:
        """The search begins."""
        if prepared.planner.unusable:
            without = listed(prepared.planner.unusable, "; ")
            self._log.event(f"run {run.number} does without: {without}")
        if prepared.flying:
            points = sum(map(len, run.snapshot.clouds))
            self._log.event(
                f"run {run.number}: {prepared.flying:,} of {points:,} points are left out as "
                "flying pixels"
            )
        for note in sight_notes(run.snapshot, prepared.environment):
            self._log.event(f"run {run.number}: {note}")
        self._outputs.environment(run.snapshot, prepared.environment)
        self._reporter.prepared(run, prepared.environment)

    def placed(self, run: Run, placement: Placement) -> None:
        """A better placement."""
        elapsed = run.elapsed
        self._outputs.solution(run.number, run.solutions, placement, elapsed, run.snapshot)
        self._reporter.placed(run, placement)
        self._log.event(
            f"run {run.number}: solution {run.solutions} after {elapsed:.2f} s, objective "
            f"{placement.objective:.4g}, arm {placement.goal.arm}"
        )

    def changed(self, run: Run) -> None:
        """Another state."""
        if not run.active:
            tell = self._log.failure if run.state is State.FAILED else self._log.event
            tell(f"run {run.number} ended, {run.state}, code {run.code}: {run.summary()}")
            self._outputs.draw_now()
        self._reporter.report()

    def environment_changed(self) -> None:
        """An object stands there now, or does no more."""
        self._reporter.environment_changed()
