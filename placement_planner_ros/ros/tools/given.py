"""The parameters that a file and the command line give, checked as the node would, all at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from placement_planner_ros.core.errors import ParameterError, PlacementPlannerError
from placement_planner_ros.ros.parameters.server import NOT_OURS, all_specs
from placement_planner_ros.ros.parameters.spec import Spec, Value
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.tools.findings import Findings

NODE = "placement_planner"


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """What was given.

    Attributes:
        parameters: all values, the default where a given one is bad.
        names: of the parameters that were given, whether good or bad.
    """

    parameters: ParameterSet
    names: frozenset[str]


def read_given(file: Path | None, overrides: Mapping[str, Any], findings: Findings) -> Given:
    """The parameters of a file and, over these, of the command line; says what is wrong."""
    values: dict[str, Any] = {}
    for parameters in () if file is None else _given_to(NODE, file, findings):
        for name, value in _flat(parameters, ()):
            values[name] = value
            findings.attempt(lambda: _require_fit(name, value))  # noqa: B023
    # the command line counts before the file
    values |= overrides
    good: dict[str, Any] = {}

    def take(spec: Spec) -> Value:
        if values.get(spec.name) is not None:
            try:
                good[spec.name] = spec.convert(values[spec.name])
            except PlacementPlannerError as error:
                findings.wrong(error)
        value: Value = good.get(spec.name, spec.default)
        return value

    # bad values are left out, so that all others are still looked at
    specs = all_specs(take)
    plain = ParameterSet(specs, {"arms": good["arms"]} if good.get("arms") else {}, values)
    for name, words in plain.unknown(n for n in values if not n.startswith(NOT_OURS)).items():
        # the node would plan all the same: what is for every node may be for another one
        findings.remarks.append(f"{name}: {words}")
    made = findings.attempt(lambda: ParameterSet(specs, good, values))
    return Given(made or plain, frozenset(values))


def start_in(file: Path) -> dict[str, Any] | None:
    """The start that a parameter file gives `placement_scene`, joint values by name.

    Raises:
        ParameterError: the file cannot be read.
    """
    for node, parameters in _nodes(read_yaml(file), ""):
        if node == "placement_scene" and isinstance(parameters.get("start"), Mapping):
            return {str(name): value for name, value in parameters["start"].items()}
    return None


def read_yaml(file: Path) -> Any:
    """What a YAML file holds.

    Raises:
        ParameterError: it cannot be read.
    """
    try:
        documents = list(yaml.safe_load_all(file.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        words = " ".join(str(error).split())
        raise ParameterError("file", str(file), f"cannot be read: {words}") from error
    return next((each for each in documents if each is not None), None)


def _given_to(node: str, file: Path, findings: Findings) -> list[Mapping[Any, Any]]:
    """The parameters of this node, and of every one."""
    tree = findings.attempt(lambda: read_yaml(file))
    found = [parameters for of, parameters in _nodes(tree, "") if of in ("**", "*", node)]
    if tree is not None and not found:
        findings.wrong(
            f"{file}: it has no parameters for {node}; begin it with '/**:' or '{node}:', then "
            f"'ros__parameters:'"
        )
    return found


def _nodes(tree: Any, last: str) -> Iterator[tuple[str, Mapping[Any, Any]]]:
    for key, value in tree.items() if isinstance(tree, Mapping) else ():
        if key == "ros__parameters" and isinstance(value, Mapping):
            yield last, value
        else:
            yield from _nodes(value, str(key).rpartition("/")[2])


def _flat(tree: Mapping[Any, Any], path: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        here = (*path, str(key))
        if isinstance(value, Mapping):
            yield from _flat(value, here)
        else:
            yield ".".join(here), value


def _require_fit(name: str, value: Any) -> None:
    """Refuse what ROS itself refuses in a parameter file.

    Raises:
        ParameterError: it does.
    """
    if value is None:
        raise ParameterError(name, None, "ROS refuses a name without a value; leave the line out")
    if isinstance(value, list) and {type(each) for each in value} == {int, float}:
        words = f"ROS refuses a list of integers and other numbers; write {[*map(float, value)]}"
        raise ParameterError(name, value, words)
