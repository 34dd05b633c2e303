"""The node's services: each a command that gives an answer, whatever happens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.service import Service
from std_srvs.srv import Trigger

from placement_planner_ros.core.errors import ParameterError, PlacementPlannerError
from placement_planner_ros.ros.commands import Commands
from placement_planner_ros.ros.log import Log
from placement_planner_ros.ros.outputs.answers import ServiceAnswer, answer, refusal

CHANGING = {
    "start",
    "start_with",
    "confirm_placed",
    "confirm_placed_with",
    "remove_placed",
    "clear_environment",
}
"""Services whose success is written down; how a run that is stopped ends is, in any case."""


def serve(node: Node, commands: Commands) -> None:
    """Offer the commands as services."""
    group = ReentrantCallbackGroup()

    def trigger(name: str, act: Callable[[], ServiceAnswer]) -> None:
        def respond(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            return _saying(act(), response)

        node.create_service(Trigger, name, respond, callback_group=group)

    def with_parameters(name: str, act: Callable[[Sequence[Parameter]], ServiceAnswer]) -> None:
        def respond(
            request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
        ) -> SetParametersAtomically.Response:
            return _saying(
                act([Parameter.from_parameter_msg(p) for p in request.parameters]), response
            )

        node.create_service(SetParametersAtomically, name, respond, callback_group=group)

    trigger("~/start", commands.start)
    with_parameters("~/start_with", commands.start)
    trigger("~/stop", commands.stop)
    with_parameters("~/stop_with", commands.stop_with)
    trigger("~/confirm_placed", commands.confirm_placed)
    with_parameters("~/confirm_placed_with", commands.confirm_placed_with)
    with_parameters("~/remove_placed", commands.remove_placed)
    trigger("~/clear_environment", commands.clear_environment)


def answer_always(node: Node, log: Log) -> None:
    """From now on every service of the node answers, rclpy's own for parameters too.

    Without this a callback that raises leaves its caller waiting for ever.

    Args:
        log: hears of refusals, of what begins or changes something, and of the node's own faults.
    """
    for service in node.services:
        service.callback = _always_answering(service, log)


def _always_answering(service: Service, log: Log) -> Callable[[Any, Any], Any]:
    """The service's callback, which writes down what was refused or brought about."""
    kind: Any = service.srv_type
    name = service.service_name.rpartition("/")[2]
    respond = service.callback

    def answered(request: Any, response: Any) -> Any:
        parameters = getattr(request, "parameters", [])
        said = unreadable_parameters(parameters)
        if said is None:
            try:
                return respond(request, response)
            except PlacementPlannerError as error:
                said = refusal([error])
            except (Exception, GeneratorExit, SystemExit) as error:
                log.fault("a request met a fault", error)
                words = " ".join(str(error).split())
                said = answer("INTERNAL", f"{type(error).__name__}: {words}; the log has the rest")
        return _saying(said, kind.Response(), len(parameters))

    def written_down(request: Any, response: Any) -> Any:
        response = answered(request, response)
        for success, words in _outcomes(response):
            if not success:
                log.refusal(f"{name} refused", words)
            elif name in CHANGING:
                log.event(f"{name}: {words}")
        return response

    return written_down


def _saying(said: ServiceAnswer, response: Any, parameters: int = 0) -> Any:
    """The response with the answer in it, as far as its type has room for words."""
    if hasattr(response, "success"):
        response.success, response.message = said.success, said.text
    elif hasattr(response, "result"):
        response.result.successful, response.result.reason = said.success, said.text
    elif hasattr(response, "results"):
        result = SetParametersResult(successful=said.success, reason=said.text)
        response.results = [result] * parameters
    return response


def _outcomes(response: Any) -> list[tuple[bool, str]]:
    """Whether what was asked for was done, and words; of each parameter, where it has several."""
    if hasattr(response, "success"):
        return [(response.success, response.message)]
    if hasattr(response, "result") and hasattr(response.result, "successful"):
        return [(response.result.successful, response.result.reason)]
    results = getattr(response, "results", ())
    return [(each.successful, each.reason) for each in results]


def unreadable_parameters(parameters: Sequence[ParameterMessage]) -> ServiceAnswer | None:
    """A refusal of parameters whose type does not exist."""
    known = {kind.value for kind in Parameter.Type}
    bad = [p for p in parameters if p.value.type not in known]
    if not bad:
        return None
    return refusal([ParameterError(p.name, f"type {p.value.type}", "is no type") for p in bad])
