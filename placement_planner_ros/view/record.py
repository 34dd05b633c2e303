"""The record of the node's newest run."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from placement_planner_ros.client import Solution, Status

_REJECTED = "rejected_"


@dataclass(frozen=True, slots=True, eq=False)
class Improvement:
    """A solution as it came.

    Attributes:
        solution: with its motion.
        positions: of all joints when it came, rad or m.
    """

    solution: Solution
    positions: Mapping[str, float]


@dataclass(slots=True)
class RunRecord:
    """One run.

    Attributes:
        run: its number; 0 where there has been none.
        best: its newest solution; None where there is none.
        curve: seconds since the start and ξ of each that was the best at a look.
        status: the newest of the node, whichever run it is of; None before the first.
    """

    run: int = 0
    best: Improvement | None = None
    curve: list[tuple[float, float]] = field(default_factory=list)
    status: Status | None = None
    _began: float = field(default_factory=time.monotonic)
    _ended: float | None = None

    def take_status(
        self,
        status: Status,
        newest: Callable[[int], Solution | None],
        positions: Mapping[str, float],
    ) -> None:
        """Take the newest status, and the run's best solution where it is another.

        A node that was started again counts its runs on; a run of another number, whichever, is
        another run.

        Args:
            newest: the best solution of that run of which all has been heard.
            positions: of the joints now.
        """
        self.status = status
        # another run begins anew
        if status.run != self.run:
            self.run, self.best, self.curve = status.run, None, []
            self._began, self._ended = time.monotonic(), None
        found = newest(self.run) if self.run else None
        if found is not None and (self.best is None or found.number > self.best.solution.number):
            self.best = Improvement(found, dict(positions))
            self.curve.append((found.search_time, found.objective))
            # The run has gone on for so long at least, however late the page was opened.
            self._began = min(self._began, time.monotonic() - found.search_time)
        # the clock of the run stands still once it has ended
        if status.ended and self._ended is None:
            self._ended = time.monotonic()

    @property
    def elapsed(self) -> float:
        """Seconds that the run has gone on for, as far as the page knows."""
        return (self._ended or time.monotonic()) - self._began

    @property
    def active(self) -> bool:
        """Whether it is going on."""
        return self.status is not None and self.run > 0 and not self.status.ended

    @property
    def samples(self) -> int:
        """How many the run has drawn."""
        return 0 if self.status is None else int(self.status.values.get("samples", 0))

    @property
    def rejected(self) -> dict[str, int]:
        """How many samples each constraint rejected, by its name, in the order of the checks."""
        values = {} if self.status is None else self.status.values
        return {
            name.removeprefix(_REJECTED): int(value)
            for name, value in values.items()
            if name.startswith(_REJECTED)
        }
