"""The goal-set bidirectional RRT on two-dimensional toys."""

from itertools import pairwise

import numpy as np
import pytest

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.motion.birrt import GoalSetRRT, GoalSetRRTSettings

LOWER = np.zeros(2)
UPPER = np.full(2, 10.0)
START = np.array([1.0, 1.0])


class Rectangles:
    """Closed rectangles (n, 4) xmin ymin xmax ymax in the plane; counts the edges asked for."""

    def __init__(self, *rectangles):
        self.rectangles = np.array(rectangles, dtype=float).reshape(-1, 4)
        self.asked = 0

    def edge_is_free(self, a, b):
        """Exact: clips the segment against every rectangle (slab test)."""
        self.asked += 1
        a, d = np.asarray(a), np.asarray(b) - np.asarray(a)
        for r in self.rectangles:
            enter, leave = 0.0, 1.0
            for j in range(2):
                if d[j] == 0.0:
                    if not r[j] <= a[j] <= r[j + 2]:
                        leave = -1.0
                    continue
                t = np.sort([(r[j] - a[j]) / d[j], (r[j + 2] - a[j]) / d[j]])
                enter, leave = max(enter, t[0]), min(leave, t[1])
            if enter <= leave:
                return False
        return True


# two walls that overlap, each open on one side
MAZE = ((3.0, 0.0, 3.4, 8.0), (6.0, 2.0, 6.4, 10.0))
# a closed box around (8.5, 8.5)
CLOSED = ((7.0, 7.0, 10.0, 7.3), (7.0, 7.0, 7.3, 10.0))


def make(rectangles=MAZE, seed=0, **settings):
    world = Rectangles(*rectangles)
    rng, settings = np.random.default_rng(seed), GoalSetRRTSettings(max_step=1.0, **settings)
    rrt = GoalSetRRT(LOWER, UPPER, START, world.edge_is_free, settings, rng)
    return rrt, world


def assert_sound(rrt, world, solution, goals):
    key, path = solution
    np.testing.assert_array_equal(path[0], START)
    np.testing.assert_array_equal(path[-1], goals[key])
    assert len(path) == 1 or (np.linalg.norm(np.diff(path, axis=0), axis=1) <= 1.0 + 1e-9).all()
    assert all(world.edge_is_free(a, b) for a, b in pairwise(path))


@pytest.mark.parametrize("seed", range(4))
def test_solves_a_maze_with_free_edges(seed):
    rrt, world = make(seed=seed)
    goals = {4: np.array([9.0, 9.0])}
    rrt.add_goal(4, goals[4])
    solution = rrt.solve(5000)
    assert solution is not None
    assert_sound(rrt, world, solution, goals)


def test_same_seed_same_result():
    runs = []
    for _ in range(2):
        rrt, _ = make(seed=7)
        rrt.add_goal(1, np.array([9.0, 9.0]))
        rrt.add_goal(2, np.array([9.0, 1.0]))
        first = rrt.solve(5000)
        rrt.retire_goal(first[0])
        runs.append((first, rrt.solve(5000), rrt.iterations))
    (a, b, count), (c, d, other_count) = runs
    assert count == other_count
    for one, two in ((a, c), (b, d)):
        assert one[0] == two[0]
        np.testing.assert_array_equal(one[1], two[1])


def test_an_unreachable_goal_gives_none():
    sealed = np.array([8.5, 8.5])
    rrt, _ = make(CLOSED)
    rrt.add_goal(0, sealed)
    assert rrt.solve(300) is None
    assert rrt.iterations == 300


def test_should_stop_is_honoured():
    rrt, world = make(CLOSED)
    rrt.add_goal(0, np.array([8.5, 8.5]))
    assert rrt.solve(1000, lambda: True) is None
    assert rrt.iterations == world.asked == 0
    assert rrt.solve(10**9, lambda: world.asked >= 50) is None
    assert world.asked <= 51


def test_random_order_of_adding_retiring_and_reactivating():
    """Whatever the order, reported goals are active, paths are free and nothing is lost."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        rrt, world = make(seed=seed)
        goals = {}
        while len(goals) < 12:
            q = rng.uniform(LOWER, UPPER)
            if world.edge_is_free(q, q + 1e-6):
                goals[len(goals)] = q
        active, reported = set(), set()
        for _ in range(150):
            key = int(rng.integers(len(goals)))
            action = rng.integers(3)
            if action == 0:
                rrt.add_goal(key, goals[key])
                if key not in active:
                    reported.discard(key)
                active.add(key)
            elif action == 1 and key in active:
                rrt.retire_goal(key)
                active.discard(key)
            else:
                solution = rrt.solve(int(rng.integers(1, 20)))
                if solution is not None:
                    assert solution[0] in active - reported
                    assert_sound(rrt, world, solution, goals)
                    reported.add(solution[0])
            assert set(rrt.goals) == active
        for key in set(goals) - active:
            rrt.add_goal(key, goals[key])
            reported.discard(key)
        while (solution := rrt.solve(5000)) is not None:
            assert_sound(rrt, world, solution, goals)
            assert solution[0] not in reported
            reported.add(solution[0])
        assert reported == set(goals)


def test_bad_input_is_named():
    def build(lower=LOWER, upper=UPPER, start=START):
        rng = np.random.default_rng(0)
        return GoalSetRRT(lower, upper, start, lambda a, b: True, GoalSetRRTSettings(), rng)

    for field, given in (
        ("start", {"start": np.array([1.0, 11.0])}),
        ("bounds", {"upper": np.array([np.inf, 1.0])}),
        ("bounds", {"lower": UPPER + 1}),
    ):
        with pytest.raises(ParameterError, match=field):
            build(**given)
    with pytest.raises(ParameterError, match="local_share"):
        GoalSetRRTSettings(local_share=1.0)
    rrt = build()
    rrt.add_goal(3, np.array([2.0, 2.0]))
    for key, q in ((3, [2.0, 3.0]), (5, [2.0, np.nan])):
        with pytest.raises(ParameterError, match=f"goal {key}"):
            rrt.add_goal(key, np.array(q))
