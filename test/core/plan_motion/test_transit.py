"""How planning effort is shared among arms, grasps and goals, with two-dimensional arms."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from helpers.problems import problem_of
from scipy.optimize import bisect

from benchmarks.cases import Case
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.grasp.feasible_grasps import usable_holdings
from placement_planner_ros.core.plan_motion.transit import MotionPlanner, TransitSettings
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.types import Goal

OPEN = np.array([9.0, 1.0])
SEALED = np.array([8.5, 8.5])


def sealed_corner(a, b):
    """Free but for a wall around the corner beyond (7, 7); sampled finely."""
    points = a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a)
    low = points.min(axis=1)
    return not ((low >= 7.0) & (low <= 7.3)).any()


def holding(arm, grasp=0, free=sealed_corner):
    bounds = SimpleNamespace(
        name=arm,
        lower=np.zeros(2),
        upper=np.full(2, 10.0),
        joints=("first", "second"),
        dof=2,
        turnable=(),
    )
    return SimpleNamespace(
        arm=bounds,
        grasp=grasp,
        q_start=np.ones(2),
        edge_free=free,
        can_be_left=lambda q: free(q, q),
        upright=None,
    )


def goal(arm, q, objective=0.0, grasp=0):
    return SimpleNamespace(arm=arm, grasp=grasp, q_raised=np.array(q), objective=objective)


def planner(holdings, seed=0, **settings):
    return MotionPlanner(
        holdings, TransitSettings(withdrawal=False, **settings), np.random.default_rng(seed)
    )


def spent(planner):
    """Iterations by arm and grasp."""
    return {key: trees.rrt.iterations for key, trees in planner._trees.items()}


def test_arms_with_goals_that_resist_advance_alike():
    motion = planner([holding("left"), holding("right"), holding("right", 1)])
    for arm, grasp in (("left", 0), ("right", 0), ("right", 1)):
        motion.add(goal(arm, SEALED, grasp=grasp))
    for _ in range(20):
        assert motion.plan(50, lambda: False) is None
        assert len(set(spent(motion).values())) == 1
    assert motion.iterations == 20 * 3 * 50


def test_a_stop_in_the_middle_of_a_round_favours_no_arm():
    """Whoever came off worst is first in the next round."""
    motion = planner([holding("left"), holding("right")])
    motion.add(goal("left", SEALED))
    motion.add(goal("right", SEALED))
    for _ in range(20):
        before = motion.iterations
        motion.plan(50, lambda before=before: motion.iterations >= before + 70)
    left, right = spent(motion).values()
    assert abs(left - right) <= 50
    assert left + right == 20 * 70


def test_an_arm_that_got_its_goals_late_catches_up():
    motion = planner([holding("left"), holding("right")])
    motion.add(goal("left", SEALED))
    for _ in range(4):
        motion.plan(50, lambda: False)
    motion.add(goal("right", OPEN))
    found, path = motion.plan(50, lambda: False)
    assert found.arm == "right"
    assert spent(motion)["left", 0] == 200, "the arm with fewer iterations was first"
    np.testing.assert_array_equal(path[[0, -1]], [np.ones(2), OPEN])
    assert all(sealed_corner(a, b) for a, b in pairwise(path))


@pytest.mark.parametrize("seed", range(3))
def test_goals_that_resist_starve_no_other(seed):
    """More of them than are active at a time, all of them better."""
    motion = planner([holding("left")], seed, active_goals=2, patience=30)
    for k in range(6):
        motion.add(goal("left", SEALED + 0.2 * k, objective=1.0))
    reachable = goal("left", OPEN)
    motion.add(reachable)
    found = None
    for _ in range(40):
        found = motion.plan(50, lambda: False)
        if found is not None:
            break
    assert found is not None
    assert found[0] is reachable
    assert motion.goals == 7
    motion.retire(reachable)
    motion.retire_up_to(1.0)
    assert motion.goals == 0
    assert motion.plan(50, lambda: False) is None


def test_where_the_shorter_way_round_is_shut_the_longer_one_is_taken():
    """A wall at 2 rad is all that parts the start from a goal at 3, and from it at 3 - 2π."""
    arm = holding("left", free=lambda a, b: not min(a[0], b[0]) <= 2.0 <= max(a[0], b[0]))
    arm.arm.lower, arm.arm.upper = np.array([-7.0, 0.0]), np.array([7.0, 10.0])
    arm.arm.turnable = ("first",)
    way = np.array([[3.0, 1.0], [3.0, 0.5]])
    reached = Goal("left", 0, 0, pin.SE3.Identity(), 0.0, way, 0.0, way[::-1])
    motion = planner([arm], patience=30)
    motion.add(reached)
    found = None
    for _ in range(10):
        found = found or motion.plan(50, lambda: False)
    assert found is not None
    other, path = found
    shift = np.array([-2 * np.pi, 0.0])
    np.testing.assert_allclose(other.approach, way + shift)
    np.testing.assert_allclose(other.retreat, way[::-1] + shift)
    np.testing.assert_allclose(path[-1], way[0] + shift)


def test_a_start_without_reserve_is_left_all_the_same():
    """It keeps the margin; only edges that begin there may go without what planning keeps more."""
    start, reached = np.ones(2), np.array([9.0, 8.0])

    def with_reserve(a, b):
        points = a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a)
        return bool((points.max(axis=1) >= 1.2).all())

    def edge_free(a, b):
        assert any(np.array_equal(each, start) for each in (a, b))
        return True

    tight = holding("left", free=with_reserve)
    tight.collision = SimpleNamespace(edge_free=edge_free)
    motion = planner([tight])
    motion.add(goal("left", reached))
    _, path = motion.plan(500, lambda: False)
    assert np.array_equal(path[0], start)
    assert np.array_equal(path[-1], reached)
    assert all(with_reserve(a, b) for a, b in pairwise(path[1:]))


def test_bad_settings_are_named():
    for name in ("active_goals", "patience", "winding"):
        with pytest.raises(ParameterError, match=name):
            TransitSettings(**{name: 0})


def test_of_too_many_goals_the_best_are_kept():
    one = planner([holding("left")], active_goals=1)
    for objective in np.random.default_rng(1).permutation(5000):
        one.add(goal("left", OPEN, float(objective)))
        assert one.goals <= 2000
    assert one.goals >= 1000
    found, _ = one.plan(1000, lambda: False)
    assert found.objective == 4999.0
    one.retire_up_to(4998.0)
    assert one.goals == 1


def test_a_start_with_hardly_any_reserve_is_left_all_the_same():
    """It has what planning keeps more, but not so much that edges from there are certified."""
    problem, _ = problem_of(Case("table", "wine_glass", "maximize_clearance"))
    usable, _ = usable_holdings(problem, PlannerSettings().grasp)
    held = usable[0][0]
    free, rng = held.q_start, np.random.default_rng(0)
    drawn = (rng.uniform(held.arm.lower, held.arm.upper) for _ in range(100))
    q = next(q for q in drawn if not held.collision.free(q, held._reserve))
    share = bisect(
        lambda s: 1.0 if held.collision.free(free + s * (q - free), held._reserve) else -1.0,
        0.0,
        1.0,
        xtol=1e-12,
    )
    edge = free + (share - 1e-9) * (q - free)
    assert held.collision.free(edge, held._reserve)
    assert held.edge_free(edge, edge)
    assert not held.can_be_left(edge)
    assert held.can_be_left(free)
    back = edge + 0.05 * (free - edge)
    assert not held.edge_free(edge, back)
    # as q_0 it is left all the same
    held.q_start = edge
    motion = MotionPlanner([held], TransitSettings(withdrawal=False), np.random.default_rng(0))
    motion.add(goal(held.arm.name, free, grasp=held.grasp))
    assert motion.plan(200, lambda: False) is not None
