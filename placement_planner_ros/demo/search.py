"""Asking the node for placements, and saying what happens meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from placement_planner_ros.client import PlacementClient, PlacementError, Solution
from placement_planner_ros.client.conversation import Value
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


@dataclass(frozen=True, slots=True, eq=False)
class Asking:
    """What asks the node.

    Attributes:
        planner: of the node.
        check: raises where the node has died.
        line: what is told meanwhile.
    """

    planner: PlacementClient
    check: Callable[[], None]
    line: ProgressLine

    def wait_until_ready(self) -> None:
        """Tell how far the node is until it could begin at once.

        Raises:
            DemoError: nothing is heard of it.
        """
        began = time.monotonic()
        while True:
            try:
                self.planner.wait_until_ready(1.0)
            except PlacementError as error:
                self.check()
                waited, status = time.monotonic() - began, self.planner.status
                if status is None and waited > WITHIN_S:
                    raise DemoError(f"no node after {waited:.0f} s: {error}", _UNSEEN) from error
                doing = "the node starts" if status is None else status.lacking
                self.line.show(f"  {waited:4.0f} s  {doing}")
            else:
                self.line.clear()
                return

    def search(
        self, parameters: Mapping[str, Value], seconds: float, confirm: bool
    ) -> list[Solution]:
        """Search for `seconds`, or where nothing is found by then until something is; each
        solution, the best last.

        Args:
            parameters: of the node, for this search only.
            confirm: tell the node that the object stands there.

        Raises:
            DemoError: start was refused, nothing was found, it does not hold any more, or the node
                does not answer.
        """
        found: list[Solution] = []
        late = False

        def take(solution: Solution) -> bool:
            # the best that is returned is mostly known already
            if not found or found[-1].number < solution.number:
                found.append(solution)
                self.line.say(
                    f"  {solution.search_time:6.2f} s   solution {solution.number:>3}   "
                    f"{solution.arm} arm   objective {solution.objective:.4f}"
                )
            return late

        self.line.say(f"searching for {seconds:g} s")
        try:
            try:
                best = self.planner.place(parameters, seconds, until=take)
            except PlacementError as error:
                if error.code != "NO_SOLUTION":
                    raise
                late = True  # then the first one will do
                best = self.planner.place(parameters, WITHIN_S, until=take)
            take(best)
            if confirm:
                # as an executive asks before it moves
                still = self.planner.validity(best)
                if not still:
                    raise DemoError(f"the placement does not hold any more: {still.reason}", BUSY)
                self.planner.confirm_placed(best)
        except PlacementError as error:
            self.check()
            # silence is told from a search that found nothing
            remedy = BUSY if error.code in (NO_NODE, NO_ANSWER) else PAGE
            raise DemoError(f"the node does not place it: {error}", remedy) from error
        self.line.say(best.words)
        return found
