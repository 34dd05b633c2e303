"""The parameters that a file and the command line give, checked as the node would, all at once."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from placement_planner_ros.core.did_you_mean import did_you_mean
from placement_planner_ros.core.errors import ParameterError, PlacementPlannerError
from placement_planner_ros.ros.parameters.spec import Spec
from placement_planner_ros.ros.parameters.table import (
    arm_specs,
    arms_spec,
    fixed_specs,
    sensor_pose_spec,
)
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.tools.robot_check.findings import Findings
from placement_planner_ros.scenes.yumi import TIP_FRAMES

NODE = "placement_planner"


class _Loader(yaml.SafeLoader):
    """YAML as ROS reads it: `1e-3` is a number."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?$|^[-+]?\.(inf|Inf|INF)$|^\.(nan|NaN)$"),
    list("-+0123456789."),
)


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
    everywhere: set[str] = set()
    if file is not None:
        for name, value, for_all in _of_file(file, findings):
            values[name] = value
            (everywhere.add if for_all else everywhere.discard)(name)
    values |= overrides
    return Given(_checked(values, everywhere, findings), frozenset(values))


def start_in(file: Path) -> dict[str, Any] | None:
    """The start that a parameter file gives `placement_scene`, joint values by name.

    Raises:
        ParameterError: the file cannot be read.
    """
    for node, parameters in _nodes(read_yaml(file), ()):
        if node[-1:] == ("placement_scene",) and isinstance(parameters, Mapping):
            start = parameters.get("start")
            if isinstance(start, Mapping):
                return {str(name): value for name, value in start.items()}
    return None


def read_yaml(file: Path) -> Any:
    """What a YAML file holds.

    Raises:
        ParameterError: it cannot be read.
    """
    try:
        documents = list(yaml.load_all(file.read_text(encoding="utf-8"), _Loader))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        words = " ".join(str(error).split())
        raise ParameterError("file", str(file), f"cannot be read: {words}") from error
    return next((each for each in documents if each is not None), None)


def _of_file(file: Path, findings: Findings) -> Iterator[tuple[str, Any, bool]]:
    """Name, value, and whether it is for every node."""
    try:
        tree = read_yaml(file)
    except ParameterError as error:
        findings.wrong(error)
        return
    found, others = False, []
    for node, parameters in _nodes(tree, ()):
        last = node[-1] if node else ""
        if last not in ("**", "*", NODE):
            others.append("/".join(node))
            continue
        found = True
        if not isinstance(parameters, Mapping):
            findings.wrong(f"{file}: {'/'.join(node)}: give ros__parameters names and values")
            continue
        for name, value in _flat(parameters, ()):
            for fault in _unfit(name, value):
                findings.wrong(fault)
            yield name, value, last != NODE
    if not found:
        meant = did_you_mean(NODE, [name.rpartition("/")[2] for name in others])
        findings.wrong(
            f"{file}: it has no parameters for {NODE}; begin it with '/**:' or '{NODE}:', then "
            f"'ros__parameters:'" + (f" (it has some for {meant})" if meant else "")
        )


def _nodes(tree: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    if not isinstance(tree, Mapping):
        return
    for key, value in tree.items():
        if key == "ros__parameters":
            yield path, value
        else:
            yield from _nodes(value, (*path, *str(key).strip("/").split("/")))


def _flat(tree: Mapping[Any, Any], path: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        here = (*path, str(key))
        if isinstance(value, Mapping):
            yield from _flat(value, here)
        else:
            yield ".".join(here), value


def _unfit(name: str, value: Any) -> Iterator[str]:
    """What ROS itself refuses in a parameter file."""
    if value is None:
        yield f"{name}: it has no value, which ROS refuses; give one, or leave the line out"
    if isinstance(value, list):
        if any(isinstance(each, (list, Mapping)) for each in value):
            yield f"{name}: ROS takes no lists in lists; give all numbers one after the other"
        elif {type(each) for each in value} == {int, float}:
            yield (
                f"{name} = {value}: ROS refuses a list of integers and other numbers; write "
                f"{[float(each) for each in value]}"
            )


def _checked(given: dict[str, Any], everywhere: set[str], findings: Findings) -> ParameterSet:
    specs: dict[str, Spec] = {}
    values: dict[str, Any] = {}

    def take(new: Sequence[Spec]) -> None:
        for spec in new:
            specs[spec.name] = spec
            if given.get(spec.name) is not None and not _nested(given[spec.name]):
                try:
                    values[spec.name] = spec.convert(given[spec.name])
                except PlacementPlannerError as error:
                    findings.wrong(error)

    take(fixed_specs())
    take([arms_spec(list(TIP_FRAMES))])
    for arm in values.get("arms", list(TIP_FRAMES)):
        take(arm_specs(arm, yumi=not values.get("robot_description")))
    for frame in values.get("sensor_frames", []):
        take([sensor_pose_spec(frame)])
    plain = ParameterSet(specs, {"arms": values.get("arms", list(TIP_FRAMES))})
    for name, words in plain.unknown(sorted(given)).items():
        # What is for every node may be for another one.
        if name == "use_sim_time" or name.startswith("qos_overrides."):
            continue
        if name not in everywhere or "nearest" in words:
            findings.wrong(f"{name}: {words}")
        else:
            findings.say(f"{name}: not a parameter of this node")
    try:
        return ParameterSet(specs, values)
    except PlacementPlannerError as error:
        findings.wrong(error)
        return plain


def _nested(value: Any) -> bool:
    return isinstance(value, list) and any(isinstance(each, (list, Mapping)) for each in value)
