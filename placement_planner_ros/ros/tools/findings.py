"""Findings of a check: what it understood, and everything that is wrong."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.ros.node_words import in_node_words

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
        for line in in_node_words(words).splitlines() or [""]:
            print(textwrap.indent(_FILL.fill(line), " " * indent), flush=True)

    def wrong(self, fault: Exception | str) -> None:
        """Remember that something is wrong, once."""
        said = in_node_words(str(fault)).splitlines()
        self.faults += [line for line in said if line not in self.faults]

    def attempt(self, make: Callable[[], Made]) -> Made | None:
        """What it makes; None where it raises what is wrong, or a file cannot be written."""
        try:
            return make()
        except (PlacementPlannerError, OSError) as error:
            self.wrong(error)
            return None

    def write(self, path: Path | None, make: Callable[[Path], object]) -> None:
        """Have the file written, if there is to be one."""
        if path is not None and self.attempt(lambda: [make(path)]) is not None:
            self.say(f"wrote {path}")

    def conclude(self) -> None:
        """Say everything that is remarkable, and everything that is wrong."""
        if self.remarks:
            self.title("to look at, though the node would plan")
        for remark in self.remarks:
            self.say(f"- {remark}")
        number = len(self.faults)
        many = f"{number} thing{'s are' if number > 1 else ' is'} wrong"
        self.title(many if number else "nothing is wrong: the node could plan")
        for i, fault in enumerate(self.faults, 1):
            self.say(f"{i}. {fault}")
