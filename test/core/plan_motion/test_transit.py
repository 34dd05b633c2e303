"""How planning effort is shared among arms, grasps and goals, with two-dimensional arms."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.motion.birrt import GoalSetRRTSettings
from placement_planner_ros.core.plan_motion.transit import MotionPlanner, TransitSettings
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
        name=arm, lower=np.zeros(2), upper=np.full(2, 10.0), joints=("first", "second"), dof=2
    )
    bounds.turnable, bounds.ties = (), np.zeros((0, 4))
    made = SimpleNamespace(arm=bounds, grasp=grasp, q_start=np.ones(2), upright=None)
    made.edge_free, made.can_be_left = free, lambda q: free(q, q)
    return made


def goal(arm, q, objective=0.0, grasp=0):
    return SimpleNamespace(arm=arm, grasp=grasp, q_raised=np.array(q), objective=objective)


def planner(holdings, seed=0, **settings):
    return MotionPlanner(
        holdings, TransitSettings(withdrawal=False, **settings), np.random.default_rng(seed)
    )


def test_goals_that_resist_starve_no_other():
    """More of them than are active at a time, all of them better."""
    motion = planner([holding("left")], active_goals=2, patience=30)
    for k in range(6):
        motion.add(goal("left", SEALED + 0.2 * k, objective=1.0))
    reachable = goal("left", OPEN)
    motion.add(reachable)
    found = next(filter(None, (motion.plan(50, lambda: False) for _ in range(40))))
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
    other, path = found
    shift = np.array([-2 * np.pi, 0.0])
    np.testing.assert_allclose(other.approach, way + shift)
    np.testing.assert_allclose(other.retreat, way[::-1] + shift)
    np.testing.assert_allclose(path[-1], way[0] + shift)


def test_a_goal_that_was_forgotten_begins_with_its_way_out_again():
    """More nodes than are kept of three goals that can be drawn out but not be reached."""
    arm = holding("left", free=lambda a, b: False)
    arm.collision, arm.may_pass, arm.transit_free = arm, len, lambda a, b: True
    arm.follow = lambda T, _: T.translation[1:]
    arm.object_pose = lambda q: pin.SE3(np.eye(3), np.array([0.0, *q]))
    arm.tip_pose, arm.chain = (lambda T: np.eye(4)), SimpleNamespace(fixed=np.zeros((1, 4, 4)))
    arm.held = SimpleNamespace(body=SimpleNamespace(vertices=np.ones((1, 3))))
    few = TransitSettings(active_goals=1, patience=1, rrt=GoalSetRRTSettings(max_nodes=20))
    motion = MotionPlanner([arm], few, np.random.default_rng(0))
    for k in range(3):
        motion.add(goal("left", [2.0 + k, 1.0]))
    for _ in range(12):
        assert motion.plan(5, lambda: False) is None
        (trees,) = motion._trees.values()
        assert len(trees.rrt.trees()[0]) > 10
