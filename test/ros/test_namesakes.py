"""A node of the same name is told of, once it stays."""

from types import SimpleNamespace

import pytest
from rclpy.node import Node

from placement_planner_ros.ros import namesakes
from placement_planner_ros.ros.namesakes import Namesakes


@pytest.fixture
def node(ros, monkeypatch):
    """One that is looked at by hand."""
    monkeypatch.setattr(namesakes, "every", lambda *_: None)
    made = Node("planner")
    yield made
    made.destroy_node()


def looks(node, there, times):
    """What is said where so many have the name each time."""
    said = []
    looking = Namesakes(node, SimpleNamespace(warn=said.append))
    node.get_node_names_and_namespaces = lambda: [("planner", "/")] * there + [("planner", "/cell")]
    for _ in range(times):
        looking.look()
    return said


def test_another_of_the_name_is_told_once(node):
    (said,) = looks(node, 2, 20)
    assert "/planner" in said
    assert "end one of them" in said


def test_alone_or_beside_one_that_goes_it_says_nothing(node):
    assert looks(node, 1, 20) == []
    assert looks(node, 2, 5) == []


def test_the_node_looks(bench, monkeypatch):
    looked = []
    monkeypatch.setattr(namesakes, "every", lambda node, seconds, act: looked.append(act))
    bench()
    assert len(looked) == 1
