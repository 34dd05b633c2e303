"""Long work: jobs that are recorded as they end, skipped where they are recorded, with progress."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from benchmarks.json_lines import append_line, read_lines
from benchmarks.spread import spread

Entry = dict[str, Any]
Tell = Callable[[str], object]


class KeyedJob(Protocol):
    """What is to be run.

    Attributes:
        work: how long it takes beside others, for example in seconds.
        key: tells jobs apart.
    """

    @property
    def work(self) -> float: ...

    @property
    def key(self) -> str: ...


J = TypeVar("J", bound=KeyedJob)


def say(line: str) -> None:
    """Print at once, also into a pipe."""
    print(line, flush=True)


class WorkProgress:
    """Tells after each piece of work how many there are and for how long.

    Args:
        work: of each piece, beside the others.
        tell: gets the lines.
    """

    def __init__(self, work: Sequence[float], tell: Tell = say) -> None:
        self._number, self._left = len(work), sum(work)
        self._tell = tell
        self._done, self._spent = 0, 0.0
        self._started = time.monotonic()

    def done(self, text: str, work: float = 1.0) -> None:
        """A piece of so much work has ended."""
        self._done, self._spent, self._left = self._done + 1, self._spent + work, self._left - work
        left = (time.monotonic() - self._started) / self._spent * max(self._left, 0.0)
        shown = f"{left / 60:.0f} min" if left > 90 else f"{left:.0f} s"
        self._tell(f"[{self._done}/{self._number}, {shown} left] {text}")


def run_jobs(
    run: Callable[[J], Entry | list[Entry]],
    jobs: Sequence[J],
    path: Path,
    describe: Callable[[Mapping[str, Any]], str],
    processes: int = 1,
    tell: Tell = say,
) -> list[Entry]:
    """Run the jobs that the file has no entry of, and append what each returns with its `key`.

    Args:
        run: makes a job's entries; errors are to be in them.
        describe: an entry in a line.
        processes: that share the jobs.

    Returns:
        The new entries.
    """
    recorded = {entry.get("key") for entry in read_lines(path)}
    open_jobs = [job for job in jobs if job.key not in recorded]
    tell(f"{len(jobs) - len(open_jobs)} of {len(jobs)} runs are recorded in {path}")
    progress = WorkProgress([job.work for job in open_jobs], tell)
    new: list[Entry] = []
    for job, result in spread(run, open_jobs, processes):
        entries = [
            {"key": job.key, **e} for e in (result if isinstance(result, list) else [result])
        ]
        for entry in entries:
            append_line(path, entry)
        progress.done("; ".join(map(describe, entries)), job.work)
        new += entries
    return new
