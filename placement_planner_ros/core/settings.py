"""Settings: frozen dataclasses whose fields say what they mean and what they may be.

Default, words, unit and range of a setting stand once, with its field: what checks it here and what
offers it to users (the node's parameters) reads them there. The words of a field that users do not
set may stand in the docstring of its class instead.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import TypeVar, cast

from placement_planner_ros.core.errors import ParameterError

_KEY = "meaning"
FINITE = "(-inf, inf)"
"""The interval of every finite number."""

Value = TypeVar("Value")


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a setting means, and what it may be.

    Attributes:
        text: what it means, one sentence.
        unit: of its numbers, '' where there is none.
        interval: that holds its numbers, as mathematicians write it: [0, 1) is 0 but not 1.
        choices: the names it may be; () for any.
    """

    text: str = ""
    unit: str = ""
    interval: str = FINITE
    choices: tuple[str, ...] = ()

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper end of the interval, inside it or not."""
        return _interval_ends(self.interval)

    def check(self, name: str, value: object) -> None:
        """Refuse a value, or one number of a list, that the setting may not have.

        Raises:
            ParameterError: it is none of the choices, not finite, or outside the interval.
        """
        if self.choices and value not in self.choices:
            known = f"choose one of {', '.join(self.choices)}: {self.text}".rstrip(": ")
            raise ParameterError(name, value, known)
        if isinstance(value, (str, bool)):
            return
        number = cast("float", value)
        try:
            finite = math.isfinite(number)
        except TypeError as error:
            raise ParameterError(name, value, f"must be a number: {self.text}") from error
        if not finite:
            raise ParameterError(name, number, f"must be finite: {self.text}".rstrip(": "))
        lower, upper = self.ends
        above = number > lower or (number == lower and self.interval[0] == "[")
        below = number < upper or (number == upper and self.interval[-1] == "]")
        if not (above and below):
            raise ParameterError(name, number, f"must {self._where} {self.unit}".rstrip())

    @property
    def _where(self) -> str:
        lower, upper = self.ends
        if math.isinf(upper):
            return f"be {'at least' if self.interval[0] == '[' else 'above'} {lower:g}"
        return f"lie in {self.interval}"


@dataclass(frozen=True, slots=True)
class Settings:
    """What every group of settings is: checked as it is made.

    A group with a check of its own calls this `__post_init__` first. Lists and arrays are taken for
    tuples.

    Raises:
        ParameterError: a field is not what its `setting` says it may be.
    """

    def __post_init__(self) -> None:
        for each in fields(self):
            meaning = each.metadata.get(_KEY)
            value = getattr(self, each.name)
            if isinstance(each.default, tuple) and not isinstance(value, tuple):
                value = _as_tuple(each.name, value)
                object.__setattr__(self, each.name, value)
            if meaning is not None:
                for one in value if isinstance(value, tuple) else (value,):
                    meaning.check(each.name, one)


def _as_tuple(name: str, value: object) -> tuple[object, ...]:
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise ParameterError(name, value, "give a list")
    return tuple(value)


@lru_cache
def _interval_ends(interval: str) -> tuple[float, float]:
    lower, upper = interval[1:-1].split(", ")
    return _parsed_number(lower), _parsed_number(upper)


def _parsed_number(text: str) -> float:
    """An integer as such, since not every one is a float."""
    return int(text) if text.removeprefix("-").isdigit() else float(text)


def setting(
    default: Value,
    interval: str = FINITE,
    unit: str = "",
    text: str = "",
    choices: tuple[str, ...] = (),
) -> Value:
    """A field of settings, see `Meaning`: a number, a name, a truth value, or a tuple of these."""
    return field(default=default, metadata={_KEY: Meaning(text, unit, interval, choices)})


def meaning_of(settings: Settings, name: str) -> Meaning:
    """What the field of that name means, and may be."""
    meaning: Meaning = type(settings).__dataclass_fields__[name].metadata[_KEY]
    return meaning
