"""One run of the planner in a worker thread."""

from __future__ import annotations

import enum
import threading
import time
from typing import Protocol

from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.types import Placement
from placement_planner_ros.ros.run.planning import Planner, Prepare, Prepared
from placement_planner_ros.ros.run.snapshot import Snapshot


class State(enum.StrEnum):
    """Where a run is, as `~/status` says it."""

    IDLE = "idle"
    PREPARING = "preparing"
    SEARCHING = "searching"
    STOPPING = "stopping"
    STOPPED = "stopped"
    TIME_LIMIT = "time_limit"
    EXHAUSTED = "exhausted"
    ROBOT_MOVED = "robot_moved"
    FAILED = "failed"


POLL = 0.05
"""Seconds between looks at whether a run that waits has been stopped."""

ENDED = (State.STOPPED, State.TIME_LIMIT, State.EXHAUSTED, State.ROBOT_MOVED, State.FAILED)


class RunObserver(Protocol):
    """Hears of a run's progress, in its worker thread."""

    def prepared(self, run: Run, prepared: Prepared) -> None:
        """The environment is ready; the search begins."""
        ...

    def placed(self, run: Run, placement: Placement) -> None:
        """A placement better than the one before."""
        ...

    def changed(self, run: Run) -> None:
        """The run's state changed."""
        ...


class Run:
    """Plans from one snapshot until told to stop, out of time, or done.

    Args:
        number: the run's, increasing over the node's life.
        prepare: makes the planner.
        observer: told of everything that happens.
        warm: set once everything a search needs is compiled. Until then the worker waits, so that
            it can be stopped, and the time limit does not count.

    Attributes:
        state, code, reason: where it is; the code and the reason of a failure.
        solutions: placements published.
        best: the last of them.
        confirmed: whether that has been carried out.
    """

    def __init__(
        self,
        number: int,
        snapshot: Snapshot,
        prepare: Prepare,
        observer: RunObserver,
        warm: threading.Event,
    ) -> None:
        self.number = number
        self.snapshot = snapshot
        self.state = State.PREPARING
        self.code = "OK"
        self.reason = ""
        self.solutions = 0
        self.best: Placement | None = None
        self.confirmed = False
        self.planner: Planner | None = None
        limit = snapshot.parameters["time_limit"]
        self._started = time.monotonic()
        self._deadline = self._started + limit if limit > 0.0 else float("inf")
        self._prepare = prepare
        self._warm = warm
        self._observer = observer
        self._ending: State | None = None
        self._publishing = threading.Lock()
        # A daemon, so that an objective that hangs does not keep the process alive.
        self._thread = threading.Thread(target=self._work, name=f"run {number}", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    @property
    def active(self) -> bool:
        """Whether the worker has not ended yet."""
        return self.state not in ENDED

    @property
    def elapsed(self) -> float:
        """Seconds since the run was asked for."""
        return time.monotonic() - self._started

    def end(self, outcome: State) -> None:
        """Ask the worker to end with that outcome; once this returns nothing more is published."""
        with self._publishing:
            if self._ending is not None or not self.active:
                return
            self._ending = outcome
            self.state = State.STOPPING
        self._observer.changed(self)

    def wait(self, timeout: float) -> bool:
        """Whether the worker is idle, after at most that many seconds."""
        if self._thread.is_alive():
            self._thread.join(timeout)
        return not self._thread.is_alive()

    def should_stop(self) -> bool:
        """Whether the search must end now."""
        return self._ending is not None or time.monotonic() >= self._deadline

    def summary(self) -> str:
        """In words, what was found, or why nothing was."""
        if self.best is not None:
            found = f"{self.solutions} solutions, the best by arm {self.best.goal.arm}"
            return f"{found}; ended because {self.reason}" if self.reason else found
        if self.reason:
            return f"no solution: {self.reason}"
        if self.planner is None:
            return "no solution: the run ended before the search began"
        return f"no solution: {self.planner.statistics.why_nothing()}"

    def _work(self) -> None:
        try:
            outcome = self._search()
        except PlacementPlannerError as error:
            outcome, self.code, self.reason = State.FAILED, error.code, str(error)
        except (Exception, SystemExit) as error:
            # The thread's outermost frame: an objective plug-in may raise anything, and whatever
            # it is must end this run only.
            outcome = State.FAILED
            self.code, self.reason = "BAD_PARAMETER", f"{type(error).__name__}: {error}"
        with self._publishing:
            self.state = self._ending or outcome
        self._observer.changed(self)

    def _wait_until_warm(self) -> None:
        if self._warm.is_set():
            return
        began = time.monotonic()
        while self._ending is None and not self._warm.wait(POLL):
            pass
        self._deadline += time.monotonic() - began

    def _search(self) -> State:
        self._wait_until_warm()
        if self.should_stop():
            return State.TIME_LIMIT
        prepared = self._prepare(self.snapshot, self.should_stop)
        if prepared is None:
            return State.TIME_LIMIT
        self.planner = prepared.planner
        with self._publishing:
            if self._ending is None:
                self.state = State.SEARCHING
        self._observer.prepared(self, prepared)
        for placement in prepared.planner.run(self.should_stop):
            with self._publishing:
                if self._ending is not None:
                    break
                self.solutions += 1
                self.best = placement
                self._observer.placed(self, placement)
            if self.should_stop():
                break
        if self.should_stop():
            return State.TIME_LIMIT
        self.reason = prepared.planner.exhausted
        return State.EXHAUSTED
