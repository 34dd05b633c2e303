"""Asking the node for placements, and saying what happens meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable

from placement_planner_ros.client import PlacementClient, PlacementError, Solution
from placement_planner_ros.demo.processes import DemoError
from placement_planner_ros.progress import ProgressLine

READY_WITHIN_S, SEEN_WITHIN_S, FIRST_WITHIN_S = 900.0, 60.0, 120.0
"""Within which the node must be ready, which takes minutes where nothing is compiled; must have
said something; and must find a first placement."""
_LOOK_S = 0.2
"""Between looks."""
_UNSEEN = (
    "nothing is heard of the node though its process runs: look whether the firewall lets UDP pass "
    "on this machine, unset RMW_IMPLEMENTATION, ROS_DISCOVERY_SERVER and "
    "FASTRTPS_DEFAULT_PROFILES_FILE, or choose another ROS_DOMAIN_ID"
)
BUSY = "is the machine busy? Try again when it is not"
PAGE = "docs/troubleshooting.md says what each code means"


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
            planner.wait_until_ready(_LOOK_S)
        except PlacementError as error:
            check()
            # a node that says nothing and one that is not ready need different remedies
            waited, status = time.monotonic() - began, planner.status
            if waited > (SEEN_WITHIN_S if status is None else READY_WITHIN_S):
                remedy = _UNSEEN if status is None else BUSY
                raise DemoError(f"no ready node after {waited:.0f} s: {error}", remedy) from error
            doing = "the node starts" if status is None else status.lacking
            line.show(f"  {waited:4.0f} s  {doing}")
        else:
            line.clear()
            return


def search(
    planner: PlacementClient, seconds: float, check: Callable[[], None], line: ProgressLine
) -> list[Solution]:
    """Search, and go on for `seconds` from the first placement on; each solution, the best last.

    Args:
        check: raises where the node has died.

    Raises:
        DemoError: start was refused, nothing was found, or the node does not answer.
    """
    try:
        # without a limit: how long it goes on is decided here, from the first placement on
        run = planner.start({"time_limit": 0.0}, patience=FIRST_WITHIN_S)
    except PlacementError as error:
        check()
        raise DemoError(f"the node refused to start: {error}", PAGE) from error
    began, found = time.monotonic(), list[Solution]()
    # until a first placement, then for so many seconds more
    end = began + FIRST_WITHIN_S
    try:
        while time.monotonic() < end and not _run_ended(planner, run):
            check()
            for solution in _new_solutions(planner, run, found):
                if not found:
                    end = time.monotonic() + seconds
                    line.say(
                        f"the first placement came {solution.search_time:.2f} s after the start; "
                        f"searching for a better one for {seconds:g} s more"
                    )
                _take_solution(found, solution, line)
            tried = "0" if planner.status is None else planner.status.values.get("samples", "0")
            waited = time.monotonic() - began
            line.show(f"  {waited:4.0f} s  searching; {tried} poses tried so far")
            time.sleep(_LOOK_S)
        best = planner.stop(run)
    except PlacementError as error:
        check()
        # silence is told from a search that found nothing
        if error.code in ("NO_NODE", "NO_ANSWER"):
            raise DemoError(f"the node does not answer any more: {error}", BUSY) from error
        raise DemoError(
            f"no placement was found in {time.monotonic() - began:.0f} s: {error}",
            f"the message says what stood in the way; {PAGE}",
        ) from error
    # what came between the last look and the stop
    for solution in [*_new_solutions(planner, run, found), best]:
        _take_solution(found, solution, line)
    line.say(f"stopped after {time.monotonic() - began:.1f} s: {best.words}")
    return found


def _run_ended(planner: PlacementClient, run: int) -> bool:
    status = planner.status
    return status is not None and status.run == run and status.ended


def _new_solutions(planner: PlacementClient, run: int, found: list[Solution]) -> list[Solution]:
    """Solutions that are not in `found`, in order: several may come between two looks."""
    newest = planner.improvement(run)
    if newest is None:
        return []
    # those before the newest that have come since the last look
    last = found[-1].number if found else 0
    between = (planner.improvement(run, number) for number in range(last + 1, newest.number))
    return [*(each for each in between if each is not None), newest]


def _take_solution(found: list[Solution], solution: Solution, line: ProgressLine) -> None:
    """Keep and print a solution that is news."""
    # the best that stop returns is mostly known already
    if found and found[-1].number >= solution.number:
        return
    found.append(solution)
    line.say(
        f"  {solution.search_time:6.2f} s   solution {solution.number:>3}   "
        f"{solution.arm} arm   objective {solution.objective:.4f}"
    )
