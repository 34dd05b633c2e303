"""Declares the parameters on a node and keeps their current values."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException, ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from placement_planner_ros.core.errors import ParameterError, PlacementPlannerError, sayable
from placement_planner_ros.core.robot.joint_limits import FIELD
from placement_planner_ros.ros.parameters.spec import Spec
from placement_planner_ros.ros.parameters.table import (
    GONE,
    arm_specs,
    arms_spec,
    fixed_specs,
    joint_limit_spec,
    sensor_pose_spec,
)
from placement_planner_ros.ros.parameters.values import MOST_HINTS, ParameterSet
from placement_planner_ros.scenes.yumi import TIP_FRAMES

_TYPES = {
    "bool": Parameter.Type.BOOL,
    "integer": Parameter.Type.INTEGER,
    "double": Parameter.Type.DOUBLE,
    "string": Parameter.Type.STRING,
    "double[]": Parameter.Type.DOUBLE_ARRAY,
    "integer[]": Parameter.Type.INTEGER_ARRAY,
    "string[]": Parameter.Type.STRING_ARRAY,
}


class UnknownParameterError(ParameterNotDeclaredException):
    """There is no such parameter; rclpy answers its client with these words."""

    def __init__(self, name: str, value: object, remedy: str) -> None:
        error = ParameterError(name, value, remedy)
        ParameterException.__init__(self, f"{error.field} = {error.value!r}", error.remedy)


_NOT_OURS = ("qos_overrides.", f"{FIELD}.")
"""How names begin that are parameters only where somebody asks for them, or MoveIt's."""

OnChange = Callable[[Sequence[str], ParameterSet], None]


class ParameterServer:
    """The parameters of one node. Typed dynamically, so that 1 may be given for 1.0.

    Attributes:
        current: all values; replaced as a whole when one changes.

    Raises:
        PlacementPlannerError: a value given at start-up is bad.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._on_change: OnChange | None = None
        self._check: OnChange | None = None
        specs: dict[str, Spec] = {}
        values: dict[str, Any] = {}

        def declare(new: Sequence[Spec]) -> None:
            for spec in new:
                specs[spec.name] = spec
                values[spec.name] = self._declare(spec)

        self._refuse_gone()
        declare(fixed_specs())
        declare([arms_spec(list(TIP_FRAMES))])
        for arm in values["arms"]:
            declare(arm_specs(arm, yumi=not values["robot_description"]))
        for frame in values["sensor_frames"]:
            declare([sensor_pose_spec(frame)])
        given = (joint_limit_spec(name) for name in getattr(node, "given", ()))
        declare([spec for spec in given if spec is not None])
        self.current = ParameterSet(specs, values)
        node.add_pre_set_parameters_callback(self._convert)
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._store)

    def notify(self, on_change: OnChange) -> None:
        """Call this with names and all values whenever parameters were set."""
        self._on_change = on_change

    def check_with(self, check: OnChange) -> None:
        """Call this before parameters are set; a PlacementPlannerError it raises refuses them."""
        self._check = check

    def with_changes(self, parameters: Sequence[Parameter]) -> ParameterSet:
        """Current values with some replaced, stored nowhere.

        Raises:
            PlacementPlannerError: a name or a value is bad.
        """
        return self.current.changed({p.name: p.value for p in parameters})

    def faults(self, parameters: Sequence[Parameter]) -> list[PlacementPlannerError]:
        """Everything for which `with_changes` would refuse these."""
        return self.current.faults({p.name: p.value for p in parameters})

    def strange(self, given: Iterable[str]) -> list[str]:
        """What to say of names given at start-up that the node does not have."""
        mine = [n for n in given if not self._node.has_parameter(n) and not n.startswith(_NOT_OURS)]
        more = [f"and {len(mine) - MOST_HINTS} more"] if len(mine) > MOST_HINTS else []
        hints = self.current.unknown(mine[:MOST_HINTS])
        return [f"{name}: {words}" for name, words in hints.items()] + more

    def _refuse_gone(self) -> None:
        """Refuse parameters of former versions given at start-up."""
        for name, remedy in GONE.items():
            anything = ParameterDescriptor(dynamic_typing=True)
            given = self._node.declare_parameter(name, descriptor=anything).value
            self._node.undeclare_parameter(name)
            if given is not None:
                raise ParameterError(name, given, remedy)

    def _declare(self, spec: Spec) -> Any:
        given = self._node.declare_parameter(spec.name, spec.default, _descriptor(spec)).value
        value = spec.convert(given)
        self._node.set_parameters([Parameter(spec.name, _TYPES[spec.kind], value)])
        return value

    def _convert(self, parameters: list[Parameter]) -> list[Parameter]:
        """Give values the type of their parameter; bad ones are left for `_validate` to refuse."""
        strange = [p for p in parameters if not self._node.has_parameter(p.name)]
        for name, remedy in self.current.unknown(p.name for p in strange[:1]).items():
            raise UnknownParameterError(name, strange[0].value, remedy)
        return [self._converted(parameter) for parameter in parameters]

    def _converted(self, parameter: Parameter) -> Parameter:
        name = parameter.name
        spec = self.current.specs.get(name)
        if spec is None:
            return parameter
        try:
            return Parameter(name, _TYPES[spec.kind], self.current.convert(name, parameter.value))
        except PlacementPlannerError:
            return parameter

    def _validate(self, parameters: list[Parameter]) -> SetParametersResult:
        mine = [p for p in parameters if p.name in self.current.specs]
        try:
            changed = self.with_changes(mine)
            if self._check is not None:
                self._check([p.name for p in mine], changed)
        except PlacementPlannerError as error:
            self._keep_types(mine)
            return SetParametersResult(successful=False, reason=sayable(str(error)))
        return SetParametersResult(successful=True)

    def _keep_types(self, refused: Sequence[Parameter]) -> None:
        """Describe them by their own types again: rclpy takes that of any value, before it asks."""
        for each in refused:
            kind = self.current.specs[each.name].kind
            self._node.describe_parameter(each.name).type = _TYPES[kind].value

    def _store(self, parameters: list[Parameter]) -> None:
        mine = [p for p in parameters if p.name in self.current.specs]
        if not mine:
            return
        self.current = self.with_changes(mine)
        if self._on_change is not None:
            self._on_change([p.name for p in mine], self.current)


def _descriptor(spec: Spec) -> ParameterDescriptor:
    meaning, notes = spec.meaning, []
    if meaning.unit:
        notes.append(f"unit: {meaning.unit}")
    if meaning.choices:
        notes.append(f"one of {', '.join(meaning.choices)}")
    if spec.startup:
        notes.append("read at start-up")
    descriptor = ParameterDescriptor(
        description=meaning.text, additional_constraints="; ".join(notes), dynamic_typing=True
    )
    lower, upper = meaning.ends
    if math.isfinite(lower) and math.isfinite(upper):
        if spec.kind.startswith("double"):
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(lower), to_value=float(upper))
            ]
        elif spec.kind.startswith("integer"):
            descriptor.integer_range = [IntegerRange(from_value=int(lower), to_value=int(upper))]
    return descriptor
