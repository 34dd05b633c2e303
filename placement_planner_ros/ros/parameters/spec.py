"""One parameter of the node: what it is called, what it means, and which values it takes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.settings import Meaning, Settings, meaning_of

Kind = Literal["bool", "integer", "double", "string", "double[]", "integer[]", "string[]"]
Value = bool | int | float | str | list[float] | list[int] | list[str]

Check = Callable[[str, Any], object]
"""Raises a PlacementPlannerError where a value alone, given with its name, shows to be bad."""

_KINDS: dict[str, Kind] = {
    "bool": "bool",
    "int": "integer",
    "float": "double",
    "str": "string",
    "tuple[float, ...]": "double[]",
    "tuple[str, ...]": "string[]",
}
"""By how a field of settings is declared; names with choices are strings."""
_ACCEPTED: dict[str, tuple[type, ...]] = {
    "bool": (bool, np.bool_),
    "integer": (int, np.integer),
    "double": (int, float, np.number),
    "string": (str,),
}
_AN = {"bool": "true or false", "integer": "an integer", "double": "a number", "string": "a string"}


@dataclass(frozen=True, slots=True)
class Spec:
    """One parameter.

    Attributes:
        name: as users set it.
        kind: its type; where it is a double, integers are accepted.
        default: its value when nothing is set.
        meaning: its words and unit, and what each of its numbers or names may be.
        startup: read once at start-up; refused afterwards.
        check: what else the value must fulfil.
    """

    name: str
    kind: Kind
    default: Value
    meaning: Meaning
    startup: bool = False
    check: Check | None = None

    @classmethod
    def of(cls, name: str, settings: Settings, path: str, check: Check | None = None) -> Spec:
        """The parameter that sets one field of settings, at a path such as `ik.sweep_step`."""
        # settings hold settings: go down to those that have the field
        *groups, field = path.split(".")
        for group in groups:
            settings = getattr(settings, group)
        default, meaning = getattr(settings, field), meaning_of(settings, field)
        kind = _KINDS.get(str(type(settings).__dataclass_fields__[field].type), "string")
        default = list(default) if isinstance(default, tuple) else default
        return cls(name, kind, default, meaning, check=check)

    def convert(self, value: object) -> Value:
        """The value in this parameter's type; nothing is an empty list.

        Numbers may come as text: YAML takes `1e-05` for one, and `ros2 param set` and `load` all of
        `[0, 0.5]`.

        Raises:
            PlacementPlannerError: wrong type, not finite, outside the range, or refused by `check`.
        """
        if self.kind.startswith("double") and isinstance(value, str):
            value = _number_or_list(value)
        converted: Any
        if self.kind.endswith("[]"):
            value = [] if value is None else value
            if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
                raise ParameterError(self.name, value, f"give a list: {self.meaning.text}")
            converted = [self._element(v) for v in value]
        else:
            converted = self._element(value)
        if self.check is not None:
            self.check(self.name, converted)
        return converted

    def _element(self, value: Any) -> bool | int | float | str:
        kind = self.kind.removesuffix("[]")
        # to Python a bool is an integer, which nobody means
        is_bool = isinstance(value, (bool, np.bool_))
        if is_bool != (kind == "bool") or not isinstance(value, _ACCEPTED[kind]):
            raise ParameterError(self.name, value, f"give {_AN[kind]}: {self.meaning.text}")
        if kind != "bool":
            self.meaning.check(self.name, value)
        return {"bool": bool, "string": str, "integer": int, "double": float}[kind](value)


def own_spec(
    name: str,
    kind: Kind,
    default: Value,
    text: str,
    check: Check | None = None,
    *,
    startup: bool = False,
    **meaning: Any,
) -> Spec:
    """A parameter of ROS' own; see `Spec`, and `Meaning` for the rest."""
    return Spec(name, kind, default, Meaning(text, **meaning), startup, check)


def _number_or_list(text: str) -> float | list[float] | str:
    """The number, or the numbers in square brackets, that a text is; else the text."""
    inner = text.strip()
    numbers = inner[1:-1].split(",") if inner[:1] == "[" and inner[-1:] == "]" else [inner]
    try:
        values = [float(number) for number in numbers]
    except ValueError:
        return text
    return values[0] if numbers == [inner] else values
