"""The node's services, called by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from placement_planner_ros.client.waiting import News

Value = bool | int | float | str | Sequence[bool] | Sequence[int] | Sequence[float] | Sequence[str]
"""What a parameter may be; NumPy's arrays and numbers are taken too."""

_TYPES = {
    "start_with": SetParametersAtomically,
    "stop_with": SetParametersAtomically,
    "confirm_placed": Trigger,
    "confirm_placed_with": SetParametersAtomically,
    "remove_placed": SetParametersAtomically,
    "clear_environment": Trigger,
}


class Calls:
    """Clients of one node's services.

    Args:
        planner: the planning node's name.
        news: told of each answer.
    """

    def __init__(self, node: Node, planner: str, group: CallbackGroup, news: News) -> None:
        self._node = node
        self._news = news
        self._clients = {
            name: node.create_client(kind, f"{planner}/{name}", callback_group=group)
            for name, kind in _TYPES.items()
        }

    def close(self) -> None:
        """Call no more."""
        for client in self._clients.values():
            self._node.destroy_client(client)

    def offered(self, name: str) -> bool:
        """Whether somebody offers the service."""
        return bool(self._clients[name].service_is_ready())

    def full_name(self, name: str) -> str:
        """The service's name as it is on the network."""
        return str(self._node.resolve_service_name(self._clients[name].srv_name))

    def send(self, name: str, parameters: Mapping[str, Value]) -> Future:
        """Send a request; the future has the response."""
        request: Any = _TYPES[name].Request()
        if parameters:
            request.parameters = [parameter_message(*pair) for pair in parameters.items()]
        future = self._clients[name].call_async(request)
        future.add_done_callback(self._news.tell)
        return future


def parameter_message(name: str, value: Any) -> ParameterMessage:
    """A parameter of a request.

    Raises:
        TypeError: the value is no parameter's.
    """
    plain = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(plain, Sequence) and not isinstance(plain, str | bytes):
        plain = [each.item() if hasattr(each, "item") else each for each in plain]
        if any(isinstance(each, float) for each in plain):
            plain = [float(each) if type(each) is int else each for each in plain]
    try:
        return Parameter(name, value=plain).to_parameter_msg()
    except TypeError:
        raise TypeError(
            f"{name} = {value!r}: give a bool, a number, a string or a flat list of one of these"
        ) from None
