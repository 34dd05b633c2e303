"""Long reading, in the background, once per content, the newest first."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from typing import Generic, Literal, TypeVar

from placement_planner_ros.core.errors import PlacementPlannerError, forget_where
from placement_planner_ros.core.stopping import StoppedError, stoppable
from placement_planner_ros.ros.log import Log
from placement_planner_ros.ros.patience import STOP_PATIENCE_S
from placement_planner_ros.ros.spinning import survive

Made = TypeVar("Made")
State = Literal["none", "reading", "ready", "bad"]
"""What `~/status` says of an input."""

Read = Callable[[], Made]
"""Reads one content, `stoppable`. Raises a PlacementPlannerError where that cannot be."""

KEPT = 4
"""Contents that are known at a time besides lasting ones: those of single calls."""


class NotReadyError(PlacementPlannerError):
    """An input is still being read."""

    code = "NOT_READY"


class _Job(Generic[Made]):
    def __init__(self, read: Read[Made]) -> None:
        self.read = read
        self.lasting = False
        self.stop = threading.Event()
        self.ended = threading.Event()
        self.made: Made | None = None
        self.error: PlacementPlannerError | None = None


class Reading(Generic[Made]):
    """Contents by a key that tells them apart. Safe to use from several threads.

    Nothing here waits for a content but `wait`.

    Args:
        field: what is read, as the user names it.
        refusal: the error that says that it cannot be read.
        words: what is said of a content that was read.
        log: hears of what is read, or cannot be; None for nobody.
    """

    def __init__(
        self,
        field: str,
        refusal: type[PlacementPlannerError],
        words: Callable[[Made], str] = lambda _: "",
        log: Log | None = None,
    ) -> None:
        self._field = field
        self._refusal = refusal
        self._words = words
        self._log = log
        self._lock = threading.Lock()
        self._jobs: dict[Hashable, _Job[Made]] = {}
        self._thread: threading.Thread | None = None

    def want(self, key: Hashable, read: Read[Made], *, lasting: bool = False) -> None:
        """Have that content read, unless it is, or is being, or could not be.

        Args:
            lasting: until it is forgotten. Of the others, where there are more than `KEPT`, the one
                that was asked for longest ago is.
        """
        with self._lock:
            # the last of them is read next
            job = self._jobs.pop(key, None) or _Job(read)
            job.lasting |= lasting
            self._jobs[key] = job
            passing = [k for k, each in self._jobs.items() if not each.lasting]
            for oldest in passing[:-KEPT]:
                self._jobs.pop(oldest).stop.set()
            # a thread is there only while there is something to read
            if self._thread is None and not job.ended.is_set():
                self._thread = threading.Thread(target=self._work, name="reading", daemon=True)
                self._thread.start()

    def forget(self, key: Hashable) -> None:
        """Nobody wants that content any more."""
        with self._lock:
            job = self._jobs.pop(key, None)
        if job is not None:
            job.stop.set()

    def close(self) -> None:
        """Forget all contents, and wait a little for what is being read to be given up.

        The process that reads would else outlive this one.
        """
        for key in list(self._jobs):
            self.forget(key)
        thread = self._thread
        if thread is not None:
            thread.join(STOP_PATIENCE_S)

    def state(self, key: Hashable) -> State:
        """How far reading that content is."""
        job = self._job(key)
        if job is None:
            return "none"
        if not job.ended.is_set():
            return "reading"
        return "ready" if job.error is None else "bad"

    def get(self, key: Hashable) -> Made:
        """The content.

        Raises:
            NotReadyError: it has not been read yet.
            PlacementPlannerError: it could not be read.
        """
        job = self._job(key)
        if job is None or not job.ended.is_set():
            words = f"start again when ~/status says {self._field}: ready"
            raise NotReadyError(self._field, "being read", words)
        if job.error is not None:
            raise job.error.with_traceback(None)  # which would grow each time
        assert job.made is not None
        return job.made

    def wait(self, key: Hashable, patience: float | None = None) -> None:
        """Return once that content is read, cannot be, or is wanted no more."""
        job = self._job(key)
        if job is not None:
            job.ended.wait(patience)

    def _job(self, key: Hashable) -> _Job[Made] | None:
        with self._lock:
            return self._jobs.get(key)

    def _work(self) -> None:
        while True:
            with self._lock:
                left = [(k, job) for k, job in self._jobs.items() if not job.ended.is_set()]
                # with the lock held: what is wanted from now on begins another thread
                if not left:
                    self._thread = None
                    return
            # the newest first: who gave it waits for it
            key, job = left[-1]
            met: list[BaseException] = []
            with stoppable(job.stop.is_set):
                job.made = survive(job.read, met.append)
            if met:
                job.error = self._refused(met[0])
                forget_where(job.error)
            # last, as whoever waits looks at the result at once
            job.ended.set()
            # nothing is said of what nobody wants any more
            if self._log is not None and self._job(key) is job:
                if job.error is not None:
                    self._log.repeats(f"{self._field} refused", str(job.error))
                elif job.made is not None and (words := self._words(job.made)):
                    self._log.event(words)

    def _refused(self, error: BaseException) -> PlacementPlannerError:
        """What is told of something that could not be read; it comes from anywhere."""
        if isinstance(error, PlacementPlannerError):
            return error
        if isinstance(error, StoppedError):
            return NotReadyError(self._field, "not read", "it was replaced")
        if self._log is not None:
            self._log.fault(f"{self._field} cannot be read for a fault", error)
        told = f"cannot be read: {type(error).__name__}: {error}"
        return self._refusal(self._field, "the newest", told)
