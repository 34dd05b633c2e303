"""The node's services: each a command that gives an answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.ros.commands import Commands
from placement_planner_ros.ros.outputs.answers import Answer, refusal


def serve(node: Node, commands: Commands) -> None:
    """Offer the commands as services."""
    group = ReentrantCallbackGroup()

    def trigger(name: str, act: Callable[[], Answer]) -> None:
        def respond(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            said = act()
            response.success, response.message = said.success, said.text
            return response

        node.create_service(Trigger, name, respond, callback_group=group)

    def with_parameters(name: str, act: Callable[[Sequence[Parameter]], Answer]) -> None:
        def respond(
            request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
        ) -> SetParametersAtomically.Response:
            said = unreadable(request.parameters)
            if said is None:
                said = act([Parameter.from_parameter_msg(p) for p in request.parameters])
            response.result.successful, response.result.reason = said.success, said.text
            return response

        node.create_service(SetParametersAtomically, name, respond, callback_group=group)

    trigger("~/start", commands.start)
    with_parameters("~/start_with", commands.start)
    trigger("~/stop", commands.stop)
    with_parameters("~/stop_with", commands.stop_with)
    trigger("~/confirm_placed", commands.confirm_placed)
    trigger("~/clear_environment", commands.clear_environment)


def unreadable(parameters: Sequence[ParameterMessage]) -> Answer | None:
    """A refusal of parameters whose type does not exist."""
    known = {kind.value for kind in Parameter.Type}
    bad = [p for p in parameters if p.value.type not in known]
    if not bad:
        return None
    return refusal([ParameterError(p.name, f"type {p.value.type}", "is no type") for p in bad])
