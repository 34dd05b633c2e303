"""A cause, what to try, and the numbers behind it."""

from __future__ import annotations

from dataclasses import dataclass, replace

SENSOR = "sensor pose"
"""What says where a sensor is."""


@dataclass(frozen=True, slots=True)
class Remedy:
    """Something to try.

    Attributes:
        parameter: what to change, as a setting or an input is called; several with commas between.
        words: to what, or how.
    """

    parameter: str
    words: str

    def __str__(self) -> str:
        return f"{quoted(self.parameter)}: {self.words}"


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why nothing was found.

    Attributes:
        cause: the main one, a sentence with its numbers.
        remedies: what to try, the most promising first.
        details: further sentences.
    """

    cause: str
    remedies: tuple[Remedy, ...] = ()
    details: tuple[str, ...] = ()

    def cut_short(self, seconds: float) -> Explanation:
        """The same of a search that was told to stop after so long: a longer limit is no remedy."""
        remedies = tuple(each for each in self.remedies if each.parameter != "time_limit")
        if len(remedies) == len(self.remedies):
            return self
        cause = f"{self.cause}; it was stopped after {seconds:.1f} s, so let it search longer"
        return replace(self, cause=cause, remedies=remedies)

    @property
    def short(self) -> str:
        """Cause and remedies on one line."""
        tries = "; or ".join(map(str, self.remedies))
        return f"{self.cause}; try {tries}" if tries else self.cause

    def __str__(self) -> str:
        return "\n".join([self.cause, *(f"try {each}" for each in self.remedies), *self.details])


def quoted(names: str) -> str:
    """Names of settings and inputs, in the backticks by which they are known as such."""
    # what an arm has is named with its arm, which is no part of the name
    parts = (name.partition(" of arm ") for name in names.split(", "))
    return ", ".join(f"`{name}`{of}{arm}" for name, of, arm in parts)
