"""An executor whose end can be waited for."""

import threading
import time

import pytest
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from placement_planner_ros.ros.spinning import PooledExecutor, hand_out, spin_until


@pytest.fixture
def node(ros):
    made = Node("spun")
    yield made
    made.destroy_node()


def test_it_waits_for_the_callbacks_in_flight_and_begins_no_more(node):
    begun, go_on, count = threading.Event(), threading.Event(), []

    def hang():
        count.append(1)
        begun.set()
        assert go_on.wait(60.0)

    node.create_timer(0.001, hang, callback_group=ReentrantCallbackGroup())
    executor, asked = PooledExecutor(2), threading.Event()
    executor.add_node(node)
    thread = threading.Thread(target=spin_until, args=(executor, asked))
    thread.start()
    assert begun.wait(60.0)
    asked.set()
    thread.join()
    assert not executor.finish(0.05)
    go_on.set()
    assert executor.finish(60.0)
    assert len(count) <= 2
    executor.shutdown()


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


def test_all_that_is_ready_is_handed_out_once_and_what_it_raises_is_told(node):
    called, errors = [], []

    def fail():
        called.append("b")
        raise ZeroDivisionError

    executor = SingleThreadedExecutor()
    executor.add_node(node)
    node.create_timer(1e-9, lambda: called.append("a"))  # ready again whenever it is looked
    node.create_timer(1e-9, fail)
    time.sleep(0.001)
    hand_out(executor, errors.append)
    assert sorted(called) == ["a", "b"]
    assert [type(error) for error in errors] == [ZeroDivisionError]
    executor.shutdown()
    hand_out(executor, errors.append)  # and of one that is no more, nothing
    assert len(called) == 2
