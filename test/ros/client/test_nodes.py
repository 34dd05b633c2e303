"""The client with nodes of the caller's, and what it needs."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from helpers.fakes import Spinning
from helpers.searches import Doing, found
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from placement_planner_ros.client import PlacementClient, PlacementError, conversation
from placement_planner_ros.client.conversation import parameter_message


@pytest.fixture
def spun(ros):
    """Makes nodes that an executor spins in a thread."""
    made = []

    def make(executor, name="executive"):
        node = Node(name)
        executor.add_node(node)
        made.append((Spinning(executor), node))
        return node

    yield make
    for spinning, node in made:
        spinning.end()
        node.destroy_node()


def test_a_node_that_the_caller_spins_will_do(fed, spun):
    node = spun(SingleThreadedExecutor())
    with PlacementClient(node) as planner:
        placing = Doing(lambda: planner.place({}, 600.0, until=lambda s: True))
        found(fed, 0.5)
        assert placing.result.objective == 0.5
        topics = {s.topic_name for s in node.subscriptions}
        assert "/placement_planner/solution" in topics
    topics = {s.topic_name for s in node.subscriptions}
    assert not [topic for topic in topics if topic.startswith("/placement_planner")]
    assert not [c for c in node.clients if "placement_planner" in c.srv_name]


def test_a_callback_may_wait_where_several_threads_spin(fed, spun):
    node = spun(MultiThreadedExecutor(4))
    with PlacementClient(node) as planner:

        def respond(request, response):
            response.message = str(planner.place({}, 600.0, until=lambda s: True).objective)
            return response

        own = MutuallyExclusiveCallbackGroup()
        node.create_service(Trigger, "put_down", respond, callback_group=own)
        asking = fed.client.create_client(Trigger, "put_down")
        assert asking.wait_for_service(120.0)
        answered = asking.call_async(Trigger.Request())
        found(fed, 0.5)
        fed.wait(answered.done)
        assert answered.result().message == "0.5"


def test_a_node_that_nobody_spins_is_said(fed, monkeypatch):
    monkeypatch.setattr(conversation, "ANSWER_WITHIN", 0.5)
    node = Node("forgotten")
    try:
        planner = PlacementClient(node)
        with pytest.raises(PlacementError) as raised:
            planner.place({}, 5.0)
        assert raised.value.code == "NO_ANSWER"
        assert "nobody spins /forgotten" in raised.value.words
    finally:
        node.destroy_node()


@pytest.mark.parametrize("ending", ["", "planner.close();" * 2, "planner._own._context.shutdown()"])
def test_python_ends_well_whether_a_client_was_closed_or_not(ending):
    lines = (
        "from placement_planner_ros.client import PlacementClient, PlacementError",
        "planner = PlacementClient()",
        "try:",
        "    planner.wait_until_ready(0.2)",
        "except PlacementError as error:",
        "    print(error.code)",
        ending,
    )
    command = [sys.executable, "-c", "\n".join(lines)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "NO_NODE\n", "")


@pytest.mark.parametrize(
    ("value", "kept"),
    [
        (np.float64(0.5), 0.5),
        (np.arange(3), [0, 1, 2]),
        (np.array([0.5, 1.0]), [0.5, 1.0]),
        ([0, 0.5, 1], [0.0, 0.5, 1.0]),
        ((np.float32(0.5), 1), [0.5, 1.0]),
        (True, True),
        (["left"], ["left"]),
    ],
)
def test_values_become_parameters(value, kept):
    message = parameter_message("some.name", value)
    read = Parameter.from_parameter_msg(message).value
    assert (read if isinstance(kept, (bool, float)) else list(read)) == kept


def test_a_value_that_is_no_parameter_is_named():
    with pytest.raises(TypeError, match="target_volume"):
        parameter_message("target_volume", [[0.0, 1.0], [2.0, 3.0]])


def test_what_the_node_lacks_is_waited_for_and_named(bench):
    b = bench(warm=False)
    with PlacementClient() as planner:
        b.wait(lambda: planner.status is not None)
        b.wait(lambda: planner._talk.offered("start_with"))
        with pytest.raises(PlacementError) as raised:
            planner.wait_until_ready(0.3)
        assert raised.value.code == "NOT_READY"
        assert "loading kernels" in raised.value.words
        assert "no recent joint states, clouds" in raised.value.words
        half = replace(planner.status, values={"warm_progress": "3 of 9 kernels compiled"})
        assert half.lacking == "3 of 9 kernels compiled"
        waiting = Doing(lambda: planner.wait_until_ready(600.0))
        b.node._warm.set()
        b.cloud()
        b.wait(lambda: planner.status.lacking == "inputs: no recent joint states", again=b.cloud)
        assert waiting.is_alive()
        b.feed()
        assert not waiting.result.lacking
    with PlacementClient(planner="nobody") as planner, pytest.raises(PlacementError) as raised:
        planner.wait_until_ready(0.1)
    assert raised.value.code == "NO_NODE"
