"""The planning node's parameters, asked for by its services."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import ParameterEvent
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import qos_profile_parameter_events
from rclpy.task import Future

from placement_planner_ros.ros.spinning import waiting

RETRIED = 5
"""Looks after which an answer that has not come is asked for again."""


class NodeParameters:
    """What the planning node was told; asked for when it appears and whenever it changes.

    Attributes:
        values: by name; empty until they have come.
        count: another one whenever one of them is another.
        client: that asks for them.

    Args:
        planner: full name of the planning node.
    """

    def __init__(self, node: Node, planner: str, group: CallbackGroup) -> None:
        self.values: dict[str, Any] = {}
        self.count = 0
        self._planner = planner
        self._wanted, self._waited = True, 0
        self.client = AsyncParameterClient(node, planner, callback_group=group)
        self._events = node.create_subscription(
            ParameterEvent,
            "/parameter_events",
            self._hear,
            qos_profile_parameter_events,
            callback_group=group,
        )

    def ask_again(self) -> None:
        """Ask for them at the next look, as another node may be there now."""
        self._wanted = True

    def look(self) -> None:
        """Ask for them where that is due and the node is there."""
        if self._waited:
            self._waited -= 1
            return
        if not self._wanted or not self.client.services_are_ready():
            return
        self._wanted, self._waited = False, RETRIED
        self.client.list_parameters(callback=self._listed)

    def _hear(self, event: ParameterEvent) -> None:
        # many may change at once: one question answers all
        others = waiting(self._events, qos_profile_parameter_events.depth)
        if any(each.node == self._planner for each in (event, *others)):
            self._wanted = True

    def _listed(self, answer: Future) -> None:
        response = answer.result()
        if response is None:
            self._wanted = True
            return
        # all values in one call
        names = list(response.result.names)

        def got(values: Future) -> None:
            self._waited = 0
            response = values.result()
            if response is None:
                self._wanted = True
                return
            found = {
                name: parameter_value_to_python(value)
                for name, value in zip(names, response.values, strict=False)
            }
            if found != self.values:
                self.values = found
                self.count += 1

        self.client.get_parameters(names, got)
