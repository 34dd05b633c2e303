"""Work that can wait lets the answer to a call go first."""

import threading
import time

from placement_planner_ros.ros import call_priority as module
from placement_planner_ros.ros.call_priority import CallPriority


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
