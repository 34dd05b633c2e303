"""The answer of a service of the node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from placement_planner_ros.client.errors import PlacementError


@dataclass(frozen=True, slots=True)
class Answer:
    """An answer taken apart.

    Attributes:
        success: whether what was asked for was done.
        code: `OK`, or why not.
        words: the lines after the first, for people.
        run: number of the run that it is about; None where there is none.
    """

    success: bool
    code: str
    words: str = ""
    run: int | None = None

    @classmethod
    def of(cls, response: Any) -> Answer:
        """Of a response to `Trigger` or `SetParametersAtomically`: a first line such as
        `code=OK run=17` and words after it.
        """
        # SetParametersAtomically has its words in a result, Trigger has them itself
        if hasattr(response, "result"):
            success, text = response.result.successful, response.result.reason
        else:
            success, text = response.success, response.message
        first, _, words = text.partition("\n")
        values = dict(pair.split("=", 1) for pair in first.split() if "=" in pair)
        return cls(
            success, values.get("code", ""), words, int(values["run"]) if "run" in values else None
        )

    @property
    def error(self) -> PlacementError:
        """The refusal as an error."""
        return PlacementError(self.code, self.words, self.run)
