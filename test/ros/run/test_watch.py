"""Which clouds are held against which placement, and what is said of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from placement_planner_ros.ros.inputs.cloud_store import CloudStore, PointSet
from placement_planner_ros.ros.run import watch as module
from placement_planner_ros.ros.run.watch import NOT_LOOKED_AT, Watch

FREE, CUT = np.zeros((1, 3)), np.ones((1, 3))


class FakeWay:
    """Blocked by every point other than zero, in words that name the placement and the point."""

    def __init__(self, name):
        self.name = name

    def blocked_by(self, points, origin):
        return f"{self.name} {points[0, 0]:g}" if points.any() else ""


def fake_way(snapshot, environment, placement):
    placement.making()
    return FakeWay(placement.name)


class Watched:
    """A watch and its clouds."""

    def __init__(self, mode):
        self.store, self.errors = CloudStore(["points"]), []
        self.watch = Watch(self.store, self.errors.append)
        self.cloud(FREE)
        first = self.store.latest()["points"].points
        self.snapshot = SimpleNamespace(clouds=(first,), parameters={"cloud.mode": mode})

    @property
    def blocked(self):
        """What is said of the last placement."""
        return self.watch.blocked(self.snapshot, self.best)

    def cloud(self, points):
        self.store.add(PointSet(points, topic="points"))

    def place(self, name, making=lambda: None):
        """A better placement, which is looked at."""
        self.best = SimpleNamespace(name=name, making=making)
        self.look()

    def look(self):
        self.watch.look(self.snapshot, None, self.best)


@pytest.fixture
def watched(monkeypatch):
    monkeypatch.setattr(module, "way_of", fake_way)
    return lambda mode="latest": Watched(mode)


def test_what_comes_later_is_held_against_the_last_placement(watched):
    w = watched()
    w.place("a")
    assert w.blocked == ""
    w.cloud(CUT)
    w.look()
    assert w.blocked == "a 1"
    w.cloud(FREE)
    w.look()
    assert w.blocked == ""


def test_until_it_is_looked_at_nothing_is_known(watched):
    w = watched()
    w.best = SimpleNamespace(name="a", making=lambda: None)
    assert w.blocked == "", "what its run began with does not stand in its way"
    w.cloud(CUT)
    assert w.blocked == NOT_LOOKED_AT
    w.look()
    assert w.blocked == "a 1"


def test_what_has_accumulated_stays_until_it_is_forgotten(watched):
    w = watched("merge")
    w.place("a")
    w.cloud(CUT)
    w.look()
    w.store.merge(CUT, 0.01)
    w.cloud(FREE)
    w.look()
    assert w.blocked == "a 1"
    w.place("b")
    assert w.blocked == "b 1"
    w.store.clear()
    w.watch.look_again()
    w.look()
    assert w.blocked == ""


def test_what_is_forgotten_while_it_is_looked_at_is_looked_at_again(watched):
    w = watched("merge")
    w.store.merge(CUT, 0.01)

    def cleared():
        w.store.clear()
        w.watch.look_again()

    w.place("a", cleared)
    assert w.blocked == NOT_LOOKED_AT
    w.best.making = lambda: None
    w.look()
    assert w.blocked == ""


def test_what_cannot_be_looked_at_is_not_called_valid(watched):
    w = watched()

    def fail():
        raise ZeroDivisionError("a fault")

    w.place("a", fail)
    assert "cannot be held" in w.blocked
    assert isinstance(w.errors[0], ZeroDivisionError)
    w.place("b")
    assert w.blocked == ""
    w.cloud(np.full((1, 3), "no number"))
    w.look()
    assert "cannot be held" in w.blocked
    w.cloud(FREE)
    w.look()
    assert w.blocked == ""
