"""What a check has to say: what it understood, and everything that is wrong."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from typing import TypeVar

from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.robot.geometry import ShapesError

Made = TypeVar("Made")

_FILL = textwrap.TextWrapper(
    width=96, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
)


class Findings:
    """Prints what is understood as it comes, and remembers what is wrong.

    Attributes:
        faults: everything for which the node could not plan.
        remarks: what may not be as it is meant, though the node would plan.
    """

    def __init__(self) -> None:
        self.faults: list[str] = []
        self.remarks: list[str] = []

    def title(self, words: str) -> None:
        """Begin a section."""
        print(f"\n{words}\n{'-' * len(words)}", flush=True)

    def say(self, words: str, indent: int = 0) -> None:
        """Say something in it."""
        lead = " " * indent
        for line in words.splitlines() or [""]:
            print(textwrap.indent(_FILL.fill(line), lead), flush=True)

    def table(self, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Columns, of which all but the first hold numbers."""
        lines = [head, *rows]
        widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
        for line in lines:
            cells = [line[0].ljust(widths[0])]
            cells += [cell.rjust(w) for cell, w in zip(line[1:], widths[1:], strict=True)]
            print("  " + "  ".join(cells), flush=True)

    def wrong(self, fault: Exception | str) -> None:
        """Remember that something is wrong."""
        words = str(fault)
        # Errors of a robot with several faults hold each of them.
        cause: BaseException | None = fault if isinstance(fault, Exception) else None
        while cause is not None:
            if isinstance(cause, ShapesError):
                words = cause.grouped
                break
            cause = cause.__cause__
        for line in words.splitlines():
            if line not in self.faults:
                self.faults.append(line)

    def remark(self, words: str) -> None:
        """Remember something that may not be as it is meant."""
        self.remarks.append(words)

    def attempt(self, make: Callable[[], Made]) -> Made | None:
        """What it makes; None where it raises what is wrong."""
        try:
            return make()
        except PlacementPlannerError as error:
            self.wrong(error)
            return None

    def conclude(self) -> None:
        """Say everything that is remarkable, and everything that is wrong."""
        if self.remarks:
            self.title("to look at, though the node would plan")
        for remark in self.remarks:
            self.say(f"- {remark}")
        if not self.faults:
            self.title("nothing is wrong: the node could plan")
            return
        number = len(self.faults)
        self.title(f"{number} thing{'s are' if number > 1 else ' is'} wrong")
        for i, fault in enumerate(self.faults, 1):
            self.say(f"{i}. {fault}")
