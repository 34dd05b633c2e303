"""Answers of the services: a machine-readable first line, then plain words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from placement_planner_ros.core.errors import PlacementPlannerError, listed
from placement_planner_ros.ros.node_words import in_node_words


@dataclass(frozen=True, slots=True)
class ServiceAnswer:
    """What a service says.

    Attributes:
        success: as the service type has it.
        text: the first line, `code=OK run=17`, and the words after it.
    """

    success: bool
    text: str


def answer(
    code: str, words: str = "", *, success: bool | None = None, **values: object
) -> ServiceAnswer:
    """An answer; it is a success where the code is OK unless said otherwise."""
    first = " ".join([f"code={code}", *(f"{k}={shown(v)}" for k, v in values.items())])
    return ServiceAnswer(
        code == "OK" if success is None else success,
        in_node_words(f"{first}\n{words}" if words else first),
    )


def refusal(faults: Sequence[PlacementPlannerError]) -> ServiceAnswer:
    """Every fault on a line of its own, of many the first; the first line carries the first one's
    code."""
    lines = [f"{fault.code}: {' '.join(str(fault).split())}" for fault in faults]
    lines = list(dict.fromkeys(lines))  # one may have several effects
    return answer(faults[0].code, listed(lines, "\n"))


def shown(value: object) -> str:
    """A value as answers, status and manifests have it: of a number six digits, which tell apart
    what a person does; `~/objective` has all."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
