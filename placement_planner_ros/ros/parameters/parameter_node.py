"""A node that knows what it was given at start-up, and takes its own dump."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter


class ParameterNode(Node):
    """A node with parameters.

    Attributes:
        given: names of all parameters given at start-up, whether the node has them or not.
    """

    given: tuple[str, ...]

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
            self.given = tuple(each[0] for each in parameters)
            return []
        declared: list[Parameter] = super().declare_parameters(
            namespace, parameters, ignore_override
        )
        return declared

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """As rclpy's; but what is read-only may be set to the value it has.

        Every dump of a node lists such parameters of rclpy's own.
        """
        changes = [each for each in parameter_list if not self._has_for_ever(each)]
        if parameter_list and not changes:
            return SetParametersResult(successful=True)
        result: SetParametersResult = super().set_parameters_atomically(changes)
        return result

    def _has_for_ever(self, parameter: Parameter) -> bool:
        name = parameter.name
        return (
            self.has_parameter(name)
            and self.describe_parameter(name).read_only
            and self.get_parameter(name).value == parameter.value
        )
