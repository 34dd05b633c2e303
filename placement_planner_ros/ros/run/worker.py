"""One run of the planner in a worker thread."""

from __future__ import annotations

import contextlib
import enum
import threading
import time
from typing import Literal, Protocol

import pinocchio as pin

from placement_planner_ros.core.errors import ParameterError, PlacementPlannerError
from placement_planner_ros.core.explanation.explanation import SENSOR
from placement_planner_ros.core.planner import PlacementPlanner
from placement_planner_ros.core.stopping import StoppedError, stoppable
from placement_planner_ros.core.types import Placement
from placement_planner_ros.heaps import shrink_heaps
from placement_planner_ros.ros.patience import LOOK_S, PREPARING_S
from placement_planner_ros.ros.run.preparation import Prepare
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.spinning import survive


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


ENDED = (State.STOPPED, State.TIME_LIMIT, State.EXHAUSTED, State.ROBOT_MOVED, State.FAILED)

_UNPREPARED = (
    "the run was ended while robot, object and clouds were still being prepared; give it more time"
)
_TOO_LATE = "the run was told to end just as it found the first placement"
"""Said where a placement was found too late to be published."""


class Warmth(threading.Event):
    """Set once warming up is over, be it that it failed.

    Attributes:
        failure: why it failed; empty where it did not, or is not over.
        progress: how far compiling is; empty where nothing is compiled.
    """

    def __init__(self) -> None:
        super().__init__()
        self.failure = ""
        self.progress = ""

    @property
    def shown(self) -> Literal["true", "false", "failed"]:
        """As `~/status` says it."""
        if not self.is_set():
            return "false"
        return "failed" if self.failure else "true"


class RunObserver(Protocol):
    """Hears of a run's progress, in its worker thread."""

    def prepared(self, run: Run, planner: PlacementPlanner) -> None:
        """The environment is ready; the search begins."""

    def placed(self, run: Run, placement: Placement) -> None:
        """A placement better than the one before."""

    def changed(self, run: Run) -> None:
        """The run's state changed."""

    def failed(self, run: Run, error: BaseException) -> None:
        """The run is about to end over something that nobody expected, or a plug-in raised."""


class Run:
    """Plans from one snapshot until told to stop, out of time, or done.

    The time limit counts from when the search begins.

    Args:
        number: the run's, increasing over the node's life and those before.
        prepare: makes the planner.
        observer: told of everything that happens.
        warm: set once warming up is over. Until then the worker waits, so that it can be stopped.

    Attributes:
        state: where it is.
        reason: in words, why it ended, where that was not because somebody said so.
        found: how many placements were published, and the last of them; None before the first.
        poses: T_world_object of each of them, by their numbers.
        confirmed: whether one of them has been carried out.
        planner: what it plans with; None while that is prepared.
    """

    def __init__(
        self, number: int, snapshot: Snapshot, prepare: Prepare, observer: RunObserver, warm: Warmth
    ) -> None:
        self.number = number
        self.snapshot = snapshot
        self.state = State.PREPARING
        self.reason = ""
        self.found: tuple[int, Placement | None] = (0, None)
        self.poses: dict[int, pin.SE3] = {}
        self.confirmed = False
        self.planner: PlacementPlanner | None = None
        self._error_code = "INTERNAL"
        self._started = time.monotonic()
        self._deadline = float("inf")
        self._prepare = prepare
        self._warm = warm
        self._observer = observer
        self._ending: State | None = None
        self._publishing = threading.Lock()
        self._ended = threading.Event()
        # A daemon, so that an objective that hangs does not keep the process alive.
        self._thread = threading.Thread(target=self._work, name=f"run {number}", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    @property
    def solutions(self) -> int:
        """Placements published."""
        return self.found[0]

    @property
    def best(self) -> Placement | None:
        """The last of them."""
        return self.found[1]

    @property
    def active(self) -> bool:
        """Whether it has not ended yet."""
        return self.state not in ENDED

    @property
    def elapsed(self) -> float:
        """Seconds since the run was asked for."""
        return time.monotonic() - self._started

    @property
    def code(self) -> str:
        """How it ended, for programs; OK while it has not."""
        # read once, as the worker may change it meanwhile
        state = self.state
        if state is State.FAILED:
            return self._error_code
        if state is State.ROBOT_MOVED:
            return "ROBOT_MOVED"
        if state not in ENDED or self.solutions > 0:
            return "OK"
        # where there was nothing to search the planner knows the code
        cause = self.planner.cause if state is State.EXHAUSTED and self.planner else None
        return cause or "NO_SOLUTION"

    def end(self, outcome: State, reason: str = "") -> None:
        """Ask the worker to end with that outcome; once this returns nothing more is published.

        Args:
            reason: in words, where it is not that somebody said so.
        """
        with self._publishing:
            # the first reason to end is the one that counts
            if self._ending is not None or not self.active:
                return
            self._ending = outcome
            self.reason = reason or self.reason
            preparing = self.state is State.PREPARING
            if not preparing:
                self.state = State.STOPPING
        if not preparing:
            self._observer.changed(self)
        else:  # the worker lets go of it at its next step, and nobody need wait for that
            self._become(outcome)

    def wait(self, timeout: float) -> bool:
        """Whether it has ended, and said so, after at most that many seconds."""
        return self._ended.wait(timeout)

    def should_stop(self) -> bool:
        """Whether the search must end now."""
        return self._ending is not None or time.monotonic() >= self._deadline

    def summary(self) -> str:
        """In words, what was found, or why nothing was."""
        if self.best is not None:
            several = f"{self.solutions} solutions, the best"
            count = several if self.solutions > 1 else "one solution,"
            words = [f"{count} by arm {self.best.goal.arm}"]
            words += [f"ended because {self.reason}"] if self.reason else []
            words += [self.planner.explanation.cause] if self.planner is not None else []
            return "; ".join(filter(None, words))
        if self.reason or self.planner is None:
            return f"no solution: {self.reason or _UNPREPARED}"
        return f"no solution: {self._named(self.planner.explanation.short) or _TOO_LATE}"

    @property
    def why(self) -> str:
        """Why nothing was found, or has been yet, line by line; '' where nothing is to be said."""
        if self.best is not None:
            return ""
        if self.planner is None or self.state is State.FAILED:
            return self.reason
        return self._named(str(self.planner.explanation))

    @property
    def details(self) -> str:
        """Of these, the numbers that `summary` leaves out."""
        if self.planner is None or self.best is not None:
            return ""
        return self._named("\n".join(self.planner.explanation.details))

    def _named(self, words: str) -> str:
        """The words with the names of this node's own sensors."""
        frames = self.snapshot.parameters["sensor_frames"]
        names = [f"sensor_poses.{frame}" for frame in frames]
        return words.replace(f"`{SENSOR}`", ", ".join(names)) if names else words

    def fail(self, error: BaseException) -> None:
        """End over an error, in the thread that met it; what has ended is left as it is."""
        if not self.active:
            return
        try:
            self._error_code, self.reason, expected = _failure(error)
            if not expected:
                self._observer.failed(self, error)
        finally:
            # even where telling of it fails, or the run would count as active for ever
            self._become(State.FAILED)

    def _become(self, outcome: State) -> None:
        with self._publishing:
            # told to end while it was prepared, it has ended before its worker
            if not self.active:
                return
            # what somebody asked for before the worker came to its end has precedence
            self.state = self._ending or outcome
        try:
            self._observer.changed(self)
        finally:
            self._ended.set()

    def _work(self) -> None:
        # An objective plug-in may raise anything, and whatever it is must end this run only.
        outcome = survive(self._search, self.fail)
        if outcome is not None:
            self._become(outcome)
        shrink_heaps()

    def _prepared(self) -> PlacementPlanner:
        """The planner, once all is compiled.

        Raises:
            StoppedError: the run was told to end, or preparing took too long.
        """
        # compiling may take minutes; a stop must not wait for it
        while not self._warm.is_set():
            if self._ending is not None:
                raise StoppedError("waiting for compilation")
            self._warm.wait(LOOK_S)
        compiles = bool(self._warm.failure)  # as it goes, which takes as long as it takes
        latest = float("inf") if compiles else time.monotonic() + PREPARING_S
        return self._prepare(
            self.snapshot, lambda: self._ending is not None or time.monotonic() >= latest
        )

    def _search(self) -> State:
        try:
            planner = self._prepared()
        except StoppedError:
            if self._ending is None:
                raise
            return self._ending
        # the search begins, unless a stop has come meanwhile
        with self._publishing:
            if self._ending is not None:
                return self._ending
            self.planner = planner
            self.state = State.SEARCHING
        self._observer.prepared(self, planner)
        limit = self.snapshot.parameters["time_limit"]
        if limit > 0.0:
            self._deadline = time.monotonic() + limit
        # a stop in the middle of a step raises StoppedError, which here is no failure
        with contextlib.suppress(StoppedError), stoppable(self.should_stop):
            self._take_placements(planner)
        # it ended because it was told to, or because nothing is left
        outcome = State.TIME_LIMIT if self.should_stop() else State.EXHAUSTED
        # in this thread, as nobody else may look into the search
        planner.explain()
        if outcome is State.EXHAUSTED:
            self.reason = self._named(planner.exhausted)
        return outcome

    def _take_placements(self, planner: PlacementPlanner) -> None:
        for placement in planner.run(self.should_stop):
            with self._publishing:
                if self._ending is not None:
                    return
                # As one, for what is said of the last is not to be read as said of this one.
                self.found = (self.solutions + 1, placement)
                self.poses[self.solutions] = pin.SE3(placement.T_world_object)
                self._observer.placed(self, placement)
            if self.should_stop():
                return


def _failure(error: BaseException) -> tuple[str, str, bool]:
    """A run's code and reason where it ends over an error, and whether that is no fault in code."""
    # an objective that raised gets a traceback in the log, any other refusal does not
    if isinstance(error, PlacementPlannerError):
        raised = error.field == "objective" and error.__cause__ is not None
        return error.code, str(error), not raised
    if isinstance(error, StoppedError):
        words = (
            f"preparing took longer than {PREPARING_S:g} s, the last of it {error}; look "
            "at what that names: simpler meshes, fewer grasps or a larger cloud.cell_size prepare "
            "faster"
        )
        return "NO_SOLUTION", words, True
    if isinstance(error, MemoryError):
        words = (
            f"there is not enough memory: {error}; give the node more, or ask for less by a larger "
            "cloud.cell_size, a smaller target_volume or thinner clouds"
        )
        return "INTERNAL", words, False
    if isinstance(error, Exception):
        words = f"{type(error).__name__}: {error}; a fault of the planner's own"
        return "INTERNAL", words, False
    # In a worker thread nothing but an objective raises SystemExit and the like.
    mine = ParameterError("objective", type(error).__name__, "the objective raised it")
    return mine.code, str(mine), False
