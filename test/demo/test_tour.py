"""The tour: the node is told of each thing, and that each stands where it was planned."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from placement_planner_ros.client import PlacementError, Validity
from placement_planner_ros.demo import command, tour
from placement_planner_ros.demo.processes import DemoError
from placement_planner_ros.progress import ProgressLine
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.yumi import start_configuration

SOLUTION = SimpleNamespace(run=17, number=1)


class Node:
    """A client, a publisher and a node's parameters, all of which remember what they hear."""

    def __init__(self):
        self.confirmed, self.shown, self.told = [], [], []
        self.validity_of = Validity()

    def validity(self, solution):
        return self.validity_of

    def confirm_placed(self, solution):
        if not self.told:
            raise PlacementError("NO_OBJECT", "there is none")
        self.confirmed.append(solution)

    def show(self, positions, at_rest):
        self.shown.append(positions)

    def search(self, planner, parameters, *_):
        self.told.append(parameters)
        return [SOLUTION]


@pytest.fixture
def node(monkeypatch):
    made = Node()
    monkeypatch.setattr(tour, "search", made.search)
    return made


def put_down(node, name):
    return tour.Tour(node, node, 1.0, lambda: None, ProgressLine()).put_down(name)


def test_the_node_knows_what_is_held_and_that_it_stands(node):
    for number, name in enumerate(tour.THINGS):
        assert put_down(node, name) == [SOLUTION]
        held, told = object_by_name(name), node.told[number]
        np.testing.assert_array_equal(told["object.vertices"], held.vertices.ravel())
        np.testing.assert_array_equal(told["object.triangles"], held.triangles.ravel())
        for arm, grasps in held.grasps.items():
            poses = np.reshape(told[f"{arm}.grasps"], (-1, 7))
            for given, T in zip(poses, grasps, strict=True):
                np.testing.assert_allclose(pin.XYZQUATToSE3(given), T, atol=1e-12)
    assert node.shown == [start_configuration(name) for name in tour.THINGS]
    assert node.confirmed == [SOLUTION] * 4


def test_a_placement_that_does_not_hold_any_more_is_not_confirmed(node):
    node.validity_of = Validity("something stands there now")
    with pytest.raises(DemoError, match="something stands there now"):
        put_down(node, tour.THINGS[0])
    assert node.confirmed == []


@pytest.mark.parametrize("given", [["--params-file", "x"], ["--object", "wine_glass"]])
def test_what_does_not_go_together_is_refused(given, capsys):
    with pytest.raises(SystemExit):
        command.main(["--tour", *given])
    assert "--tour" in capsys.readouterr().err
