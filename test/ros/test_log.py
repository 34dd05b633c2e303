"""What is said: each event, at most a line a second of what repeats, each traceback once."""

import itertools
import time

import pytest
from sensor_msgs.msg import JointState

from placement_planner_ros.ros import node as node_module
from placement_planner_ros.ros.log import Log


class Lines:
    """A logger that keeps what is said."""

    def __init__(self):
        self.said = []

    def info(self, words):
        self.said.append(("info", words))

    def warning(self, words):
        self.said.append(("warning", words))

    def error(self, words):
        self.said.append(("error", words))

    @property
    def words(self):
        return [words for _, words in self.said]


@pytest.fixture
def told(bench):
    """A node with inputs, and what it says from now on."""

    def make(**values):
        b, lines = bench(**values), Lines()
        b.feed()
        b.node._log._logger = lines
        return b, lines

    return make


def test_misspelt_names_are_warned_of(bench, monkeypatch):
    warned = []
    monkeypatch.setattr(Log, "warn", lambda _, words: warned.append(words))
    bench(colision_margin=0.01)
    (words,) = warned
    assert "colision_margin" in words
    assert "the nearest is collision_margin" in words


def test_bad_messages_are_told_once_a_second_whatever_differs_in_them(told):
    b, lines = told()
    began, numbers = time.monotonic(), itertools.count()

    def bad():
        b._joints.publish(JointState(name=[f"joint {next(numbers)}"], position=[]))
        b.cloud(frame=f"frame {next(numbers)}")

    for _ in range(60):
        bad()
        time.sleep(0.005)
        b.cloud()
    for kind in ("cloud on points refused", "joint state refused"):
        b.wait(lambda kind=kind: any(kind in words for words in lines.words), again=bad)
    allowed = 2 * (2 + time.monotonic() - began)
    assert len(lines.words) <= allowed, lines.words


def test_warming_up_that_fails_is_said_and_a_start_compiles_as_it_goes(told, monkeypatch):
    b, lines = told(warm=False)

    def fail_to(*_):
        raise OSError("no compiler here")

    monkeypatch.setattr(node_module, "warm_up", fail_to)
    b.node.warm_up()
    b.wait(lambda: b.status()["warm"] == "failed")
    assert b.status()["warm_failed_reason"] == "OSError: no compiler here"
    assert "warming up failed" in b.messages("status")[-1].message
    assert ["Traceback" in words for words in lines.words if "warming up" in words] == [True]
    b.feed()
    assert b.call("start").success
    b.wait(lambda: b.planners)
    b.wait(lambda: b.status()["state"] == "searching")
    assert b.status()["warm"] == "failed"
