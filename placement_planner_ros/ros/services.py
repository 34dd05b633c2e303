"""The node's services: each a command that gives an answer, whatever happens."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

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
from placement_planner_ros.ros.spinning import survive

_TRIGGERS = ("start", "stop", "confirm_placed", "clear_environment")
_WITH_PARAMETERS = ("start_with", "stop_with", "confirm_placed_with", "remove_placed")


def serve(node: Node, commands: Commands) -> None:
    """Offer the commands as services."""
    # several calls at once: a stop must not wait for the answer to another call
    group = ReentrantCallbackGroup()

    def offer(kind: type, name: str) -> None:
        act: Callable[..., ServiceAnswer] = getattr(commands, name)

        def respond(request: Any, response: Any) -> Any:
            if kind is Trigger:
                return _saying(act(), response)
            return _saying(
                act([Parameter.from_parameter_msg(p) for p in request.parameters]), response
            )

        node.create_service(kind, f"~/{name}", respond, callback_group=group)

    for name in _TRIGGERS:
        offer(Trigger, name)
    for name in _WITH_PARAMETERS:
        offer(SetParametersAtomically, name)


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
        met: list[BaseException] = []

        def act() -> Any:
            # of a type that does not exist rclpy makes no parameter, but raises
            _require_types(parameters)
            return respond(request, response)

        given = survive(act, met.append)
        for error in met:
            if isinstance(error, PlacementPlannerError):
                said = refusal([error])
            else:
                # the node's own fault, and the caller is told all the same
                log.fault("a request met a fault", error)
                words = " ".join(str(error).split())
                said = answer("INTERNAL", f"{type(error).__name__}: {words}; the log has the rest")
            given = _saying(said, kind.Response(), len(parameters))
        # refusals are always written down, successes where they change something
        for success, words in _outcomes(given):
            if not success:
                log.warn(f"{name} refused: {words}")
            elif name in (*_TRIGGERS, *_WITH_PARAMETERS):
                log.event(f"{name}: {words}")
        return given

    return answered


def _require_types(parameters: Any) -> None:
    """Refuse a parameter whose type does not exist; of names alone there is none.

    Raises:
        ParameterError: there is one.
    """
    known = {kind.value for kind in Parameter.Type}
    for each in parameters:
        if each.value.type not in known:
            raise ParameterError(each.name, f"type {each.value.type}", "is no type")


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
    results = getattr(response, "results", [getattr(response, "result", None)])
    return [(each.successful, each.reason) for each in results if hasattr(each, "successful")]
