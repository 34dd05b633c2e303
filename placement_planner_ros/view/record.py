"""The record of the node's newest run."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from placement_planner_ros.client import Solution, Status

MOST = 200
"""Solutions of a run that are remembered, the newest ones."""
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
        improvements: by number, in order.
        status: the newest of the node, whichever run it is of; None before the first.
    """

    run: int = 0
    improvements: dict[int, Improvement] = field(default_factory=dict)
    status: Status | None = None
    _began: float = field(default_factory=time.monotonic)
    _ended: float | None = None

    def take_status(
        self,
        status: Status,
        solution_of: Callable[[int, int], Solution | None],
        positions: Mapping[str, float],
    ) -> None:
        """Take the newest status and whatever it counts that has come.

        A node that was started again counts its runs on; a run of another number, whichever, is
        another run.

        Args:
            solution_of: that solution of that run, once all of it has been heard.
            positions: of the joints now.
        """
        self.status = status
        # another run begins anew
        if status.run != self.run:
            self.run, self.improvements = status.run, {}
            self._began, self._ended = time.monotonic(), None
        # Of those before the newest only what is still kept can be had.
        known = max(self.improvements, default=0)
        for number in range(max(known + 1, status.solutions - MOST), status.solutions + 2):
            found = solution_of(self.run, number) if self.run else None
            if found is not None:
                self.improvements[number] = Improvement(found, dict(positions))
                # The run has gone on for so long at least, however late the page was opened.
                self._began = min(self._began, time.monotonic() - found.search_time)
        while len(self.improvements) > MOST:
            del self.improvements[next(iter(self.improvements))]
        # the clock of the run stands still once it has ended
        if status.ended and self._ended is None:
            self._ended = time.monotonic()

    @property
    def best(self) -> Improvement | None:
        """The newest, which is the best."""
        return self.improvements[max(self.improvements)] if self.improvements else None

    @property
    def elapsed(self) -> float:
        """Seconds that the run has gone on for, as far as the page knows."""
        return (self._ended or time.monotonic()) - self._began

    @property
    def active(self) -> bool:
        """Whether it is going on."""
        return self.status is not None and self.run > 0 and not self.status.ended

    @property
    def curve(self) -> list[tuple[float, float]]:
        """Seconds since the start and ξ of each improvement that was heard."""
        return [
            (each.solution.search_time, each.solution.objective)
            for each in self.improvements.values()
        ]

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
