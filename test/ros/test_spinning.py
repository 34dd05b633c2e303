"""An executor whose end can be waited for."""

import threading
import time

import pytest
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String

from placement_planner_ros.ros.spinning import REST_S, PooledExecutor, hand_out, spin_until, waiting


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


def test_it_rests_between_looks_and_none_of_what_comes_meanwhile_is_lost(node):
    looks, heard, all_heard = [], [], threading.Event()
    executor, asked = PooledExecutor(2), threading.Event()
    several = [node.create_publisher(String, "told", 10) for _ in range(2)]

    def take(message):
        looks.append(time.monotonic())
        for each in (message, *waiting(told, 10)):
            heard.append(each.data)
        if len(heard) == 10:
            all_heard.set()

    told = node.create_subscription(String, "told", take, 10)
    executor.add_node(node)
    while told.get_publisher_count() < 2:
        time.sleep(0.01)
    for number in range(5):
        for who, publisher in zip("ab", several, strict=True):
            publisher.publish(String(data=f"{who}{number}"))
    thread = threading.Thread(target=spin_until, args=(executor, asked))
    thread.start()
    took_all = all_heard.wait(60.0)
    first, waited_for = len(looks), list(heard)
    looks.clear()
    began = time.monotonic()
    while time.monotonic() < began + 30 * REST_S or not looks:
        several[0].publish(String(data="again"))
        time.sleep(REST_S / 20)
    asked.set()
    thread.join()
    ended = executor.finish(60.0)
    executor.shutdown()
    assert took_all
    assert ended
    assert first < len(waited_for), "one look for each"
    for who in "ab":
        assert [each for each in waited_for if each[0] == who] == [f"{who}{n}" for n in range(5)]
    assert 0 < len(looks) <= (looks[-1] - began) / REST_S + 2


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
