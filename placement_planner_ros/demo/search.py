"""Asking the node for placements, and saying what happens meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from placement_planner_ros.client import PlacementClient, PlacementError, Solution
from placement_planner_ros.client.errors import NO_ANSWER, NO_NODE
from placement_planner_ros.demo.processes import DemoError
from placement_planner_ros.progress import ProgressLine

WITHIN_S = 120.0
"""Within which the node must be heard of, and must find a first placement."""
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
        DemoError: nothing is heard of it.
    """
    began = time.monotonic()
    while True:
        try:
            planner.wait_until_ready(1.0)
        except PlacementError as error:
            check()
            waited, status = time.monotonic() - began, planner.status
            if status is None and waited > WITHIN_S:
                raise DemoError(f"no node after {waited:.0f} s: {error}", _UNSEEN) from error
            doing = "the node starts" if status is None else status.lacking
            line.show(f"  {waited:4.0f} s  {doing}")
        else:
            line.clear()
            return


def search(
    planner: PlacementClient,
    parameters: Mapping[str, Any],
    seconds: float,
    check: Callable[[], None],
    line: ProgressLine,
) -> list[Solution]:
    """Search for `seconds`, or where nothing is found by then until something is; each solution,
    the best last.

    Args:
        parameters: of the node, for this search only.
        check: raises where the node has died.

    Raises:
        DemoError: start was refused, nothing was found, or the node does not answer.
    """
    found: list[Solution] = []

    def take(solution: Solution) -> None:
        # the best that is returned is mostly known already
        if found and found[-1].number >= solution.number:
            return
        found.append(solution)
        line.say(
            f"  {solution.search_time:6.2f} s   solution {solution.number:>3}   "
            f"{solution.arm} arm   objective {solution.objective:.4f}"
        )

    line.say(f"searching for {seconds:g} s")
    try:
        best = _search(planner, parameters, seconds, take)
    except PlacementError as error:
        check()
        # silence is told from a search that found nothing
        remedy = BUSY if error.code in (NO_NODE, NO_ANSWER) else PAGE
        raise DemoError(f"the node gives no placement: {error}", remedy) from error
    take(best)
    line.say(best.words)
    return found


def _search(
    planner: PlacementClient,
    parameters: Mapping[str, Any],
    seconds: float,
    take: Callable[[Solution], None],
) -> Solution:
    try:
        return planner.place(parameters, seconds, until=take)
    except PlacementError as error:
        if error.code in (NO_NODE, NO_ANSWER):
            raise

    def enough(solution: Solution) -> bool:
        take(solution)
        return True

    # then the first one will do
    return planner.place(parameters, WITHIN_S, until=enough)
