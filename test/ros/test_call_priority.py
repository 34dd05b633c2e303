"""Work that can wait lets the answer to a call go first."""

import threading
import time

import pytest
from helpers.fakes import Spinning
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from placement_planner_ros.ros import call_priority as module
from placement_planner_ros.ros.call_priority import CallPriority
from placement_planner_ros.ros.spinning import PooledExecutor


def waiting_for(calls):
    """A thread that gives way, and what it sets once it went on."""
    went_on = threading.Event()

    def give_way():
        calls.give_way()
        went_on.set()

    threading.Thread(target=give_way, daemon=True).start()
    return went_on


def test_a_call_that_takes_long_holds_nothing_up(monkeypatch):
    monkeypatch.setattr(module, "LOOK_S", 0.01)
    calls = CallPriority()
    with calls.answering():
        assert waiting_for(calls).wait(30.0)


@pytest.mark.usefixtures("ros")
def test_a_service_is_being_answered_until_its_answer_has_left(monkeypatch):
    monkeypatch.setattr(module, "LOOK_S", 60.0)
    calls, seen = CallPriority(), []
    node, caller = Node("answers"), Node("asks")

    def respond(_, response):
        seen.append(waiting_for(calls))
        assert not seen[0].wait(0.05)
        return response

    served = node.create_service(Trigger, "ask", respond)
    send = served.send_response
    monkeypatch.setattr(
        served,
        "send_response",
        lambda *given: (seen.append(seen[0].wait(0.05)), send(*given)),
    )
    answering, asking = PooledExecutor(2, calls), SingleThreadedExecutor()
    answering.add_node(node)
    asking.add_node(caller)
    spinning = [Spinning(answering), Spinning(asking)]
    client = caller.create_client(Trigger, "ask")
    assert client.wait_for_service(120.0)
    assert client.call(Trigger.Request(), 120.0) is not None
    assert seen[1] is False  # nothing had gone on as the answer left
    assert seen[0].wait(30.0)
    for each in spinning:
        each.end()
    node.destroy_node()
    caller.destroy_node()


def test_clouds_give_way(bench, monkeypatch):
    monkeypatch.setattr(module, "LOOK_S", 60.0)
    bench = bench()
    bench.feed()
    clouds, waits = bench.node._inputs.clouds, threading.Event()
    give_way = bench.node.calls.give_way
    monkeypatch.setattr(bench.node.calls, "give_way", lambda: (waits.set(), give_way()))
    with bench.node.calls.answering():
        bench.cloud()
        assert waits.wait(30.0)
        before = clouds.updates
        time.sleep(0.05)
        assert clouds.updates == before
    bench.wait(lambda: clouds.updates > before)
