"""Asking the node for placements, and saying what happens meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from placement_planner_ros.client import PlacementClient, PlacementError, Solution
from placement_planner_ros.demo.errors import DemoError
from placement_planner_ros.progress import ProgressLine

READY_WITHIN = 900.0
"""Seconds within which the node must be ready; where nothing is compiled that takes minutes."""
SEEN_WITHIN = 60.0
"""Seconds within which it must have said something: it starts in some."""
FIRST_WITHIN = 120.0
"""Seconds within which a first placement must come."""
_LOOK = 0.2
"""Seconds between looks."""
_UNSEEN = (
    "nothing is heard of the node though its process runs: look whether the firewall lets UDP pass "
    "on this machine, unset RMW_IMPLEMENTATION, ROS_DISCOVERY_SERVER and "
    "FASTRTPS_DEFAULT_PROFILES_FILE, or choose another ROS_DOMAIN_ID"
)
BUSY = "is the machine busy? Try again when it is not"
PAGE = "docs/troubleshooting.md says what each code means"


@dataclass(frozen=True, slots=True)
class Found:
    """What a search has found.

    Attributes:
        improvements: each solution, in order; the last is the best.
        seconds: from the start of the run to its end.
    """

    improvements: list[Solution] = field(default_factory=list)
    seconds: float = 0.0


def wait_until_ready(
    planner: PlacementClient, check: Callable[[], None], line: ProgressLine
) -> None:
    """Tell how far the node is until it could begin at once.

    Args:
        check: raises where that will never be.

    Raises:
        DemoError: it does not get ready.
    """
    began = time.monotonic()
    while True:
        try:
            planner.wait_until_ready(_LOOK)
        except PlacementError as error:
            check()
            waited, status = time.monotonic() - began, planner.status
            if status is None and waited > SEEN_WITHIN:
                raise DemoError(
                    f"no sign of the node within {SEEN_WITHIN:.0f} s", _UNSEEN
                ) from error
            if waited > READY_WITHIN:
                raise DemoError(
                    f"the node is not ready after {READY_WITHIN:.0f} s: {error}", BUSY
                ) from error
            doing = "the node starts" if status is None else status.lacking
            line.show(f"  {waited:4.0f} s  {doing or 'the node starts'}")
        else:
            line.clear()
            return


def _tried_words(planner: PlacementClient) -> str:
    """How many poses were tried so far, in words; '' where that is not known."""
    samples = 0 if planner.status is None else int(planner.status.values.get("samples", 0))
    return f"; {samples:,} poses tried so far" if samples else ""


def search(
    planner: PlacementClient, seconds: float, check: Callable[[], None], line: ProgressLine
) -> Found:
    """Search, and go on for `seconds` from the first placement on.

    Args:
        check: raises where the node has died.

    Raises:
        DemoError: start was refused, nothing was found, or the node does not answer.
    """
    try:
        run = planner.start({"time_limit": 0.0}, patience=FIRST_WITHIN)
    except PlacementError as error:
        check()
        raise DemoError(f"the node refused to start: {error}", PAGE) from error
    began, found = time.monotonic(), Found()
    first: float | None = None
    try:
        while not _run_ended(planner, run):
            now = time.monotonic()
            for solution in _new_solutions(planner, run, found):
                if first is None:
                    first, came = now, f"{solution.search_time:.2f} s after the start"
                    line.say(f"the first placement came {came}")
                    line.say(f"searching for a better one for {seconds:g} s more")
                _take_solution(found, solution, line)
            if now > (began + FIRST_WITHIN if first is None else first + seconds):
                break
            shown = (
                f"{now - began:4.0f} s  searching{_tried_words(planner)}"
                if first is None
                else (
                    f"{now - first:4.0f} of {seconds:g} s  searching; "
                    f"{_placement_count(len(found.improvements))} so far"
                )
            )
            line.show(f"  {shown}")
            check()
            time.sleep(_LOOK)
        best = planner.stop(run)
    except PlacementError as error:
        check()
        if error.code in ("NO_NODE", "NO_ANSWER"):
            raise DemoError(f"the node does not answer any more: {error}", BUSY) from error
        raise DemoError(
            f"no placement was found in {time.monotonic() - began:.0f} s: {error}",
            f"the message says what stood in the way; {PAGE}",
        ) from error
    for solution in [*_new_solutions(planner, run, found), best]:
        _take_solution(found, solution, line)
    line.say(f"stopped after {time.monotonic() - began:.1f} s: {best.words}")
    return Found(found.improvements, time.monotonic() - began)


def _placement_count(number: int) -> str:
    return "1 placement" if number == 1 else f"{number} placements"


def _run_ended(planner: PlacementClient, run: int) -> bool:
    status = planner.status
    return status is not None and status.run == run and status.ended


def _new_solutions(planner: PlacementClient, run: int, found: Found) -> list[Solution]:
    """Solutions that are not in `found`, in order: several may come between two looks."""
    newest = planner.improvement(run)
    if newest is None:
        return []
    last = found.improvements[-1].number if found.improvements else 0
    between = (planner.improvement(run, number) for number in range(last + 1, newest.number))
    return [*(each for each in between if each is not None), newest]


def _take_solution(found: Found, solution: Solution, line: ProgressLine) -> None:
    """Keep and print a solution that is news."""
    if found.improvements and found.improvements[-1].number >= solution.number:
        return
    found.improvements.append(solution)
    line.say(
        f"  {solution.search_time:6.2f} s   solution {solution.number:>3}   "
        f"{solution.arm} arm   objective {solution.objective:.4f}"
    )
