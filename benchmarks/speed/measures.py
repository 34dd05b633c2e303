"""Timing, percentiles, and a bounded random subset of a stream."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import numpy as np

from placement_planner_ros.core.errors import ParameterError

T = TypeVar("T")

_REPEATS = 10_000


def cpu_seconds(action: Callable[[], object], at_least: float = 0.05) -> float:
    """CPU time of one call, mean over as many as take `at_least` seconds together.

    It counts this process alone, so that other processes on the machine do not count.
    """
    calls, started = 0, time.process_time()
    while True:
        action()
        calls += 1
        spent = time.process_time() - started
        if spent >= at_least or calls == _REPEATS:
            return spent / calls


def median(values: Sequence[float]) -> float:
    """NaN of nothing."""
    return float(np.median(values)) if len(values) else float("nan")


def percentile(values: Sequence[float], share: float) -> float:
    """The value below which `share` percent of the values lie; NaN of nothing."""
    return float(np.percentile(values, share)) if len(values) else float("nan")


class Reservoir(Generic[T]):
    """A uniform random subset of a stream of unknown length (Vitter's algorithm R).

    Args:
        size: how many items are kept at most.
        rng: chooses them.

    Attributes:
        seen: how many were offered.

    Raises:
        ParameterError: size is below one.
    """

    def __init__(self, size: int, rng: np.random.Generator) -> None:
        if size < 1:
            raise ParameterError("reservoir size", size, "must be at least 1")
        self._size = size
        self._rng = rng
        self._kept: list[tuple[int, T]] = []
        self.seen = 0

    def offer(self, item: T) -> None:
        """Keep it, perhaps."""
        entry = (self.seen, item)
        self.seen += 1
        if len(self._kept) < self._size:
            self._kept.append(entry)
            return
        place = int(self._rng.integers(self.seen))
        if place < self._size:
            self._kept[place] = entry

    @property
    def items(self) -> list[T]:
        """The subset, in the order in which it was offered."""
        return [item for _, item in sorted(self._kept, key=lambda entry: entry[0])]
