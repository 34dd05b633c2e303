"""An executor whose end can be waited for."""

import threading

import pytest
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from placement_planner_ros.ros.spinning import PooledExecutor, spin_until


@pytest.fixture
def node(ros):
    made = Node("spun")
    yield made
    made.destroy_node()


def test_what_callbacks_raise_is_told_one_by_one_and_ends_nothing(node):
    errors = []

    def fail(name):
        def raises():
            raise ZeroDivisionError(name)

        return raises

    for name in "ab":
        node.create_timer(0.01, fail(name), callback_group=ReentrantCallbackGroup())
    executor, asked = PooledExecutor(2), threading.Event()
    executor.add_node(node)
    enough = threading.Event()

    def on_error(error):
        errors.append(str(error))
        if {"a", "b"} <= set(errors) and len(errors) > 4:
            enough.set()

    thread = threading.Thread(target=spin_until, args=(executor, asked, on_error))
    thread.start()
    assert enough.wait(60.0)
    asked.set()
    thread.join()
    assert executor.finish(60.0)
    executor.shutdown()
