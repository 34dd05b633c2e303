"""Which clouds are held against which placement, and what is said of them."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from placement_planner_ros.ros.inputs.cloud_store import CloudStore, PointSet
from placement_planner_ros.ros.run import watch as module
from placement_planner_ros.ros.run.watch import NOT_LOOKED_AT, Watch

FREE, CUT, CUT_TOO = np.zeros((1, 3)), np.ones((1, 3)), np.full((1, 3), 2.0)
WITHIN = 120.0


class FakeWay:
    """Blocked by every point other than zero, in words that name the placement and the point."""

    def __init__(self, name):
        self.name = name

    def blocked_by(self, points, origin):
        return f"{self.name} {points[0, 0]:g}" if points.any() else ""


def fake_way(snapshot, environment, placement):
    placement.making()
    return FakeWay(placement.name)


def placement(name, making=lambda: None):
    return SimpleNamespace(name=name, making=making)


class Watched:
    """A watch, its clouds, and what it told."""

    def __init__(self, monkeypatch, mode="latest"):
        monkeypatch.setattr(module, "way_of", fake_way)
        self.store = CloudStore(["points"])
        self.told, self.errors = [], []
        self.best = None
        self.watch = Watch(self.store, self._changed, self.errors.append)
        self.first = FREE + 0.0
        self.cloud(self.first)
        self.snapshot = SimpleNamespace(clouds=(self.first,), parameters={"cloud.mode": mode})
        self.watch.follow(self.snapshot)
        self.watch.planned_in(self.snapshot, SimpleNamespace(obstacles=None))

    def _changed(self):
        self.told.append(self.blocked)

    @property
    def blocked(self):
        """What is said of the last placement."""
        return "" if self.best is None else self.watch.blocked(self.best)

    def cloud(self, points, topic="points"):
        self.store.add(PointSet(points, topic=topic))

    def place(self, name, making=lambda: None):
        """A better placement, once it is looked at and that is told."""
        self.told.clear()
        self.begin_to_place(name, making)
        self.until(lambda: self.watch._looked_at is self.best and self.told)
        self.told.clear()

    def look_at(self, points):
        """A cloud comes, and is looked at."""
        self.cloud(points)
        newest = self.store.latest()["points"].points
        self.until(lambda: any(c.points is newest for c, _ in self.watch._seen.values()))

    def begin_to_place(self, name, making):
        self.best = placement(name, making)
        self.watch.placed(self.snapshot, self.best)

    def until(self, condition):
        waiting = threading.Event()
        for _ in range(int(WITHIN / 0.005)):
            if condition():
                return
            waiting.wait(0.005)
        raise AssertionError("waited in vain")


@pytest.fixture
def watched(monkeypatch):
    made = []

    def make(**options):
        made.append(Watched(monkeypatch, **options))
        return made[-1]

    yield make
    for each in made:
        each.watch.close()


def test_a_cloud_that_comes_while_the_way_is_made_is_looked_at(watched):
    w = watched()
    w.place("a", making=lambda: w.cloud(CUT))
    w.until(lambda: w.blocked == "a 1")


def test_a_cloud_that_comes_while_another_is_looked_at_is_looked_at(watched, monkeypatch):
    w = watched()
    w.place("a")
    looked = FakeWay.blocked_by

    def late(self, points, origin):
        if points.any():
            w.cloud(FREE + 0.0)
        return looked(self, points, origin)

    monkeypatch.setattr(FakeWay, "blocked_by", late)
    w.cloud(CUT)
    w.until(lambda: w.told == ["a 1", ""])


def test_what_has_accumulated_stays_until_it_is_forgotten(watched):
    w = watched(mode="merge")
    w.place("a")
    w.look_at(CUT)
    w.store.merge(CUT, 0.01)
    w.look_at(FREE + 0.0)
    assert w.blocked == "a 1"
    w.place("b")
    assert w.blocked == "b 1"
    w.store.clear()
    w.watch.look_again()
    w.until(lambda: w.blocked == "")


def test_a_new_run_begins_without_what_was_said_of_the_last(watched):
    w = watched()
    w.place("a")
    w.look_at(CUT)
    late = w.snapshot
    w.watch.follow(SimpleNamespace(clouds=(), parameters={"cloud.mode": "latest"}))
    assert w.blocked == NOT_LOOKED_AT  # of the new run, nothing is
    w.watch.placed(late, placement("late"))
    w.watch.planned_in(late, None)
    w.cloud(CUT_TOO)
    assert w.told == ["a 1"]


def test_what_cannot_be_looked_at_is_not_called_valid(watched):
    w = watched()

    def fail():
        raise ZeroDivisionError("a fault")

    w.begin_to_place("a", fail)
    w.until(lambda: "cannot be held" in w.blocked)
    assert isinstance(w.errors[0], ZeroDivisionError)
    w.place("b")  # and its thread goes on
    assert w.blocked == ""
    w.look_at(np.full((1, 3), "no number"))
    assert "cannot be held" in w.blocked
    w.look_at(FREE + 0.0)
    assert w.blocked == ""
