"""What takes long to read is read in the background, once per content, the newest first."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from typing import Generic, Literal, TypeVar

from placement_planner_ros.core.errors import PlacementPlannerError, forget_where
from placement_planner_ros.ros.inputs.mesh_process import MeshProcessStoppedError
from placement_planner_ros.ros.process import give_memory_back

Made = TypeVar("Made")
State = Literal["none", "reading", "ready", "bad"]
"""What `~/status` says of an input."""

ShouldStop = Callable[[], bool]
Read = Callable[[ShouldStop], Made]
"""Reads one content. Raises a PlacementPlannerError where that cannot be, and a StoppedError soon
after it is told to stop; whatever else it raises is made a PlacementPlannerError by `explain`."""

KEPT = 4
"""Contents that are known at a time besides lasting ones: those of single calls."""

_CLOSING = 0.5
"""Seconds that closing waits at most."""


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
        explain: makes what nobody expected a PlacementPlannerError.
    """

    def __init__(self, field: str, explain: Callable[[Exception], PlacementPlannerError]) -> None:
        self._field = field
        self._explain = explain
        self._lock = threading.Lock()
        self._jobs: dict[Hashable, _Job[Made]] = {}
        self._thread: threading.Thread | None = None
        self._listener: Callable[[Hashable], None] | None = None
        self._untold: list[Hashable] = []

    def listen(self, listener: Callable[[Hashable], None]) -> None:
        """Call this with the key of each content that was read, or could not be."""
        with self._lock:
            self._listener = listener
            untold, self._untold = self._untold, []
        for key in untold:
            self._tell(listener, key)

    def want(self, key: Hashable, read: Read[Made], *, lasting: bool = False) -> None:
        """Have that content read, unless it is, or is being, or could not be.

        Args:
            lasting: until it is forgotten. Of the others, where there are more than `KEPT`, the one
                that was asked for longest ago is.
        """
        with self._lock:
            job = self._jobs.pop(key, None) or _Job(read)
            job.lasting |= lasting
            self._jobs[key] = job
            passing = [k for k, each in self._jobs.items() if not each.lasting]
            for oldest in passing[:-KEPT]:
                self._jobs.pop(oldest).stop.set()
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
            thread.join(_CLOSING)

    def state(self, key: Hashable) -> State:
        """How far reading that content is."""
        with self._lock:
            job = self._jobs.get(key)
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
        with self._lock:
            job = self._jobs.get(key)
        if job is None or not job.ended.is_set():
            raise NotReadyError(
                self._field,
                "being read",
                f"start again when ~/status says {self._field}: ready",
            )
        if job.error is not None:
            raise job.error.with_traceback(None)  # which would grow each time
        assert job.made is not None
        return job.made

    def wait(self, key: Hashable, patience: float | None = None) -> None:
        """Return once that content is read, cannot be, or is wanted no more."""
        with self._lock:
            job = self._jobs.get(key)
        if job is not None:
            job.ended.wait(patience)

    @property
    def busy(self) -> bool:
        """Whether anything is being read."""
        return self._thread is not None

    def _work(self) -> None:
        while True:
            with self._lock:
                left = [(k, job) for k, job in self._jobs.items() if not job.ended.is_set()]
                if not left:
                    self._thread = None
                    return
            key, job = left[-1]
            try:
                job.made = job.read(job.stop.is_set)
            except PlacementPlannerError as error:
                job.error = error
            except MeshProcessStoppedError:
                job.error = NotReadyError(self._field, "not read", "it was replaced")
            except Exception as error:
                # The thread's outermost frame: what is read comes from anywhere.
                job.error = self._explain(error)
                job.error.__cause__ = error
            job.ended.set()
            with self._lock:
                wanted, listener = self._jobs.get(key) is job, self._listener
                if wanted and listener is None:
                    self._untold.append(key)
            if wanted and listener is not None:
                self._tell(listener, key)
            give_memory_back()

    def _tell(self, listener: Callable[[Hashable], None], key: Hashable) -> None:
        """Tell who listens of a content, where its error was raised too, for the last time."""
        listener(key)
        with self._lock:
            job = self._jobs.get(key)
        if job is not None and job.error is not None:
            forget_where(job.error)
