"""Declares the parameters on a node and keeps their current values."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from placement_planner_ros.core.errors import NAMED_THINGS, PlacementPlannerError
from placement_planner_ros.ros.node_words import in_node_words
from placement_planner_ros.ros.parameters.spec import Spec
from placement_planner_ros.ros.parameters.table import (
    arm_specs,
    arms_spec,
    fixed_specs,
    sensor_pose_spec,
)
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.scenes.yumi import TIP_FRAMES

NOT_OURS = (
    "use_sim_time",
    "qos_overrides.",
    "robot_description_planning.",
    "start_type_description_service",
)
"""How names begin that are parameters of rclpy's, or MoveIt's."""

OnChange = Callable[[Sequence[str], ParameterSet], None]
Take = Callable[[Spec], Any]
"""Takes a parameter in, and gives its value."""


def all_specs(take: Take) -> dict[str, Spec]:
    """Every parameter by name; which there are depends on the values of some.

    Args:
        take: called once for each.
    """
    specs: dict[str, Spec] = {}
    values: dict[str, Any] = {}

    def declare(new: Sequence[Spec]) -> None:
        for spec in new:
            specs[spec.name] = spec
            values[spec.name] = take(spec)

    # those first that say for which arms and sensors there are others
    declare([*fixed_specs(), arms_spec(list(TIP_FRAMES))])
    for arm in values["arms"]:
        declare(arm_specs(arm, yumi=not values["robot_description"]))
    declare([sensor_pose_spec(frame) for frame in values["sensor_frames"]])
    return specs


class ParameterNode(Node):
    """A node that knows what it was given at start-up.

    Attributes:
        given: all parameters given at start-up by name, whether the node has them or not.
    """

    given: dict[str, Any]

    def __init__(self, name: str, overrides: Sequence[Parameter] = ()) -> None:
        super().__init__(
            name,
            parameter_overrides=list(overrides),
            automatically_declare_parameters_from_overrides=True,
        )

    def declare_parameters(
        self, namespace: str, parameters: Any, ignore_override: bool = False
    ) -> list[Parameter]:
        """As rclpy's; but what was given is only remembered while the node is made.

        rclpy would declare it by the type that it happens to have, and an empty list has none.
        """
        if not hasattr(self, "given"):
            self.given = {each[0]: each[1] for each in parameters}
            return []
        declared: list[Parameter] = super().declare_parameters(
            namespace, parameters, ignore_override
        )
        return declared


class ParameterServer:
    """The parameters of one node. Typed dynamically, so that 1 may be given for 1.0.

    Attributes:
        current: all values; replaced as a whole when one changes.
        check: called with names and all values before parameters are set; a PlacementPlannerError
            that it raises refuses them.
        on_change: called with the same once they were set.

    Raises:
        PlacementPlannerError: a value given at start-up is bad.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.on_change: OnChange | None = None
        self.check: OnChange | None = None
        self._given: dict[str, Any] = getattr(node, "given", {})
        values: dict[str, Any] = {}

        def declare(spec: Spec) -> Any:
            given = node.declare_parameter(spec.name, spec.default, _descriptor(spec)).value
            values[spec.name] = spec.convert(given)
            # in the type of the parameter, where an integer was given for a double
            node.set_parameters([_typed(spec, values[spec.name])])
            return values[spec.name]

        # declared one after the other, as some say which others there are
        self.current = ParameterSet(all_specs(declare), values, self._given)
        # rclpy calls them in this order: convert, refuse, take in
        # Values get the type of their parameter; bad ones are left for `_validate` to refuse.
        node.add_pre_set_parameters_callback(lambda given: list(map(self._converted, given)))
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._store)

    def without_effect(self) -> Mapping[str, str]:
        """Names given at start-up that the node does not have, and what to do instead."""
        mine = [name for name in self._given if not name.startswith(NOT_OURS)]
        unknown = [name for name in mine if name not in self.current.specs]
        return self.current.unknown(unknown[:NAMED_THINGS])

    def _converted(self, parameter: Parameter) -> Parameter:
        name = parameter.name
        spec = self.current.specs.get(name)
        if spec is None:
            return parameter
        try:
            return _typed(spec, self.current.convert(name, parameter.value))
        except PlacementPlannerError:
            return parameter

    def _mine(self, parameters: Sequence[Parameter]) -> dict[str, Any]:
        return {p.name: p.value for p in parameters if p.name in self.current.specs}

    def _validate(self, parameters: list[Parameter]) -> SetParametersResult:
        mine = self._mine(parameters)
        try:
            changed = self.current.changed(mine)
            # what only the robot and the object can tell
            if self.check is not None:
                self.check([*mine], changed)
        except PlacementPlannerError as error:
            return SetParametersResult(successful=False, reason=in_node_words(str(error)))
        return SetParametersResult(successful=True)

    def _store(self, parameters: list[Parameter]) -> None:
        mine = self._mine(parameters)
        # replaced as a whole, so that each thread reads a consistent set
        self.current = self.current.changed(mine)
        if mine and self.on_change is not None:
            self.on_change([*mine], self.current)


def _typed(spec: Spec, value: Any) -> Parameter:
    """The parameter with a value in its type."""
    return Parameter(spec.name, Parameter.Type[spec.kind.upper().replace("[]", "_ARRAY")], value)


def _descriptor(spec: Spec) -> ParameterDescriptor:
    meaning = spec.meaning
    notes = [f"unit: {meaning.unit}"] if meaning.unit else []
    notes += [f"one of {', '.join(meaning.choices)}"] if meaning.choices else []
    notes += ["read at start-up"] if spec.startup else []
    descriptor = ParameterDescriptor(
        description=in_node_words(meaning.text),
        additional_constraints="; ".join(notes),
        dynamic_typing=True,
    )
    ends = meaning.ends
    # a range of rclpy needs both ends, each in the type of the parameter
    if all(map(math.isfinite, ends)) and spec.kind.startswith("double"):
        ends = float(ends[0]), float(ends[1])
        descriptor.floating_point_range = [FloatingPointRange(from_value=ends[0], to_value=ends[1])]
    elif all(map(math.isfinite, ends)):
        lower, upper = map(int, ends)
        descriptor.integer_range = [IntegerRange(from_value=lower, to_value=upper)]
    return descriptor
