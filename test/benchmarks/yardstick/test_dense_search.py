"""The dense search takes its grid in an order that finds what there is."""

import numpy as np

from benchmarks.yardstick.dense_search import DescendingSampler
from benchmarks.yardstick.placement_grid import GridPlacements
from placement_planner_ros.core.search.sampler import Outcome
from placement_planner_ros.core.types import Verdict


class OneFaceReached:
    """Of all poses, those on one face are reached; each goal is the number of its place."""

    def __init__(self, face):
        self.face, self.tried = face, []

    def check_batch(self, draws, best, goals, should_stop):
        assert len(draws.face) == 1
        face, number = int(draws.face[0]), round(float(draws.contact[0, 0]) / 0.1)
        self.tried.append((face, number))
        if face != self.face:
            return Outcome(np.array([Verdict.NO_IK]), np.array([1.0]), [])
        return Outcome(np.array([Verdict.FEASIBLE]), np.array([1.0]), [number])


def on_two_faces(better, worse):
    """A grid of so many poses of a face, and of another on which none is worth as much; each in a
    cell of its own."""
    number = np.arange(better + worse)
    contact = np.column_stack([0.1 * number, np.zeros((len(number), 2))])
    face = (number >= better).astype(np.int64)
    grid = GridPlacements(face, contact, np.zeros(len(number)), np.zeros(len(number)), len(number))
    values = np.where(face == 0, 2.0, 1.0) + number % 7 / 10.0
    return grid, values


def test_a_face_that_is_never_reached_does_not_keep_the_search_from_the_others():
    grid, values = on_two_faces(100_000, 20)
    checker = OneFaceReached(1)
    sampler = DescendingSampler(checker, [1], grid, values)
    goals = sampler.sample_goals(-np.inf, lambda: False)
    assert len(goals) == 8
    of_face = values[np.array(goals)]
    assert (np.diff(of_face) <= 0.0).all()
    assert of_face[0] == values[grid.face == 1].max()
    assert len(checker.tried) <= 17
    assert not sampler.finished


def test_it_is_finished_once_no_face_has_anything_better():
    grid, values = on_two_faces(30, 20)
    checker = OneFaceReached(0)
    sampler = DescendingSampler(checker, [1], grid, values)
    assert sampler.sample_goals(values[grid.face == 1].max(), lambda: False)
    assert {face for face, _ in checker.tried} == {0}
    while not sampler.finished:
        sampler.sample_goals(values[grid.face == 1].max(), lambda: False)
    assert sorted(number for _, number in checker.tried) == list(range(30))
    assert sampler.sample_goals(-np.inf, lambda: False) == []
