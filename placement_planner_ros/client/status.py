"""The node's `~/status`, read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from diagnostic_msgs.msg import DiagnosticStatus

ENDED = frozenset({"stopped", "time_limit", "exhausted", "robot_moved", "failed"})
"""States of a run that is over."""
STOPPING = "stopping"
ROBOT_MOVED = "robot_moved"


@dataclass(frozen=True, slots=True)
class Validity:
    """Whether a solution can still be carried out as it was planned.

    Attributes:
        reason: why not; empty where it can.
        known: whether the node has looked. Where it has not, ask again: it takes a moment.
    """

    reason: str = ""
    known: bool = True

    def __bool__(self) -> bool:
        return not self.reason


@dataclass(frozen=True, slots=True)
class Status:
    """One message of `~/status`.

    Attributes:
        run: number of the last run; 0 before the first.
        state: where that run is.
        code: how it ended; `OK` while it has not.
        solutions: how many it has published.
        validity: of the last of them.
        message: for people.
        values: all there is, by key: `warm`, `robot` and `object` among it.
    """

    run: int
    state: str
    code: str
    solutions: int
    validity: Validity
    message: str
    values: Mapping[str, str]

    @classmethod
    def of(cls, message: DiagnosticStatus) -> Status:
        """Of a message."""
        values = {pair.key: pair.value for pair in message.values}
        valid = values.get("best_valid") == "true"
        # without a reason the solution would pass for valid
        reason = "" if valid else values.get("best_invalid_reason") or "the node does not say why"
        return cls(
            int(values.get("run", 0)),
            values.get("state", ""),
            values.get("code", ""),
            int(values.get("solutions", 0)),
            Validity(reason, values.get("best_valid_known") == "true"),
            message.message,
            MappingProxyType(values),
        )

    @property
    def ended(self) -> bool:
        """Whether the run is over."""
        return self.state in ENDED

    @property
    def lacking(self) -> str:
        """What the node waits for or works on before it can begin a run, in words; '' where it
        could at once. What is bad is for `start` to say."""
        values, lacking = self.values, []
        # where warming up has failed runs begin all the same
        if values.get("warm") not in ("true", "failed"):
            lacking.append(values.get("warm_progress") or "loading kernels")
        lacking += [f"reading the {x}" for x in ("robot", "object") if values.get(x) == "reading"]
        if values.get("inputs", "arrive") != "arrive":
            lacking.append(f"inputs: {values['inputs']}")
        return "; ".join(lacking)
