"""One parameter of the node: what it is called, what it means, and which values it takes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.settings import Meaning, Settings, meaning_of

Kind = Literal["bool", "integer", "double", "string", "double[]", "integer[]", "string[]"]
Value = bool | int | float | str | list[float] | list[int] | list[str]

Check = Callable[[str, Any], None]
"""Raises a PlacementPlannerError where a value alone, given with its name, shows to be bad."""

_KIND: dict[type, Kind] = {bool: "bool", int: "integer", float: "double", str: "string"}
_LISTS: dict[Any, Kind] = {"tuple[float, ...]": "double[]", "tuple[str, ...]": "string[]"}
"""By how a field of settings is declared, as an empty list does not show its type."""
_AN = {"bool": "true or false", "integer": "an integer", "double": "a number", "string": "a string"}


def kind_of(value: Value) -> Kind:
    """The type of a value; of a list that is not empty, by its first element."""
    if isinstance(value, list):
        return cast("Kind", f"{_KIND[type(value[0])]}[]")
    return _KIND[type(value)]


@dataclass(frozen=True, slots=True)
class Spec:
    """One parameter.

    Attributes:
        name: as users set it.
        kind: its type; where it is a double, integers are accepted.
        default: its value when nothing is set.
        meaning: its words and unit, and what each of its numbers or names may be.
        length: how many elements a list has; -1 for any.
        startup: read once at start-up; refused afterwards.
        check: what else the value must fulfil.
        tidy: makes of a text the one that is kept.
    """

    name: str
    kind: Kind
    default: Value
    meaning: Meaning
    length: int = -1
    startup: bool = False
    check: Check | None = None
    tidy: Callable[[str], str] | None = None

    @classmethod
    def of(cls, name: str, settings: Settings, path: str, check: Check | None = None) -> Spec:
        """The parameter that sets one field of settings, at a path such as `ik.sweep_step`."""
        *groups, field = path.split(".")
        for group in groups:
            settings = getattr(settings, group)
        default, meaning = getattr(settings, field), meaning_of(settings, field)
        declared = type(settings).__dataclass_fields__[field].type
        default = list(default) if isinstance(default, tuple) else default
        kind = _LISTS[declared] if declared in _LISTS else kind_of(default)
        return cls(name, kind, default, meaning, check=check)

    def convert(self, value: object) -> Value:
        """The value in this parameter's type; nothing is an empty list.

        Numbers may come as text: YAML takes `1e-05` for one, and `ros2 param set` and `load` all of
        `[0, 0.5]`.

        Raises:
            ParameterError: wrong type or length, not finite, or outside the range.
        """
        if self.kind.startswith("double") and isinstance(value, str):
            value = _number_or_list(value)
        if value is None and self.kind.endswith("[]"):
            value = []
        if self.kind.endswith("[]"):
            if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
                raise ParameterError(self.name, value, f"give a list: {self.meaning.text}")
            converted: Any = [self._element(v) for v in value]
            if self.length >= 0 and len(converted) != self.length:
                raise ParameterError(
                    self.name, converted, f"give {self.length} values: {self.meaning.text}"
                )
        else:
            converted = self._element(value)
        if self.tidy is not None:
            converted = self.tidy(converted)
        if self.check is not None:
            self.check(self.name, converted)
        return converted

    def _element(self, value: Any) -> bool | int | float | str:
        kind = self.kind.removesuffix("[]")
        accepted = {
            "bool": isinstance(value, (bool, np.bool_)),
            "integer": isinstance(value, (int, np.integer)) and not isinstance(value, bool),
            "double": isinstance(value, (int, float, np.number)) and not isinstance(value, bool),
            "string": isinstance(value, str),
        }
        if not accepted[kind]:
            raise ParameterError(self.name, value, f"give {_AN[kind]}: {self.meaning.text}")
        if kind == "bool":
            return bool(value)
        self.meaning.check(self.name, value)
        return {"string": str, "integer": int, "double": float}[kind](value)


def _number_or_list(text: str) -> float | list[float] | str:
    """The number, or the numbers in square brackets, that a text is; else the text."""
    inner = text.strip()
    numbers = inner[1:-1].split(",") if inner[:1] == "[" and inner[-1:] == "]" else [inner]
    try:
        values = [float(number) for number in numbers]
    except ValueError:
        return text
    return values[0] if numbers == [inner] else values
