"""Ways out of goals, for a hand that moves freely in the plane between two walls."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from placement_planner_ros.core.plan_motion.withdrawal import straight_way, winding_way

GOAL = np.array([1.0, 0.0])
"""x, y of the object; the arm's base is at the origin."""


def holding(free, limit=2.0):
    """Its configurations are positions of the object; only edges within `free` points are free."""

    def transit_free(a, b):
        points = a + np.linspace(0.0, 1.0, 40)[:, None] * (b - a)
        return bool(all(free(x, y) for x, y in points))

    def follow(T, q):
        reached = T.translation[:2].copy()
        in_plane = abs(T.translation[2]) < 0.015
        return reached if in_plane and (np.abs(reached) <= limit).all() else None

    return SimpleNamespace(
        arm=SimpleNamespace(
            name="arm",
            joints=("x", "y"),
            turnable=(),
            ties=np.zeros((0, 4)),
            lower=np.full(2, -limit),
            upper=np.full(2, limit),
        ),
        grasp=0,
        q_start=np.array([0.0, -1.0]),
        chain=SimpleNamespace(fixed=np.eye(4)[None]),
        collision=SimpleNamespace(edge_free=transit_free),
        tip_pose=lambda T: T.homogeneous,
        object_pose=lambda q: pin.SE3(np.eye(3), np.array([*q, 0.0])),
        follow=follow,
        transit_free=transit_free,
        edge_free=transit_free,
        can_be_left=lambda q: True,
        upright=None,
    )


def in_corridor(x, y):
    """A corridor bends: 6 cm towards the base, then sideways."""
    inwards = 0.94 <= x <= 1.01 and abs(y) <= 0.01
    return inwards or (0.85 <= x <= 0.97 and y >= -0.01) or y > 0.2 or x < 0.5


def check(way, goal, transit_free):
    np.testing.assert_array_equal(way[0], goal)
    assert all(transit_free(a, b) for a, b in pairwise(way))


def test_the_straight_way_leads_to_the_base():
    hand = holding(lambda x, y: abs(y) < 0.01)
    way = straight_way(hand, GOAL)
    check(way, GOAL, hand.transit_free)
    np.testing.assert_allclose(way[-1], [1.0 - 12 * 0.03, 0.0], atol=1e-12)


@pytest.mark.parametrize("seed", range(2))
def test_a_winding_way_goes_on_where_the_straight_one_ends(seed):
    hand = holding(in_corridor)
    straight = straight_way(hand, GOAL)
    rng = np.random.default_rng(seed)
    way = straight
    for _ in range(20):
        longer = winding_way(hand, way, rng)
        if longer is None:
            continue
        check(longer, GOAL, hand.transit_free)
        assert np.linalg.norm(longer[-1] - GOAL) > np.linalg.norm(way[-1] - GOAL)
        way = longer
    assert np.linalg.norm(straight[-1] - GOAL) < 0.2
    assert np.linalg.norm(way[-1] - GOAL) >= 0.3


def test_what_is_out_already_is_left_alone_and_so_is_what_cannot_move():
    rng = np.random.default_rng(0)
    out = np.linspace(GOAL, GOAL - [0.36, 0.0], 13)
    assert winding_way(holding(lambda x, y: True), out, rng) is None
    stuck = holding(lambda x, y: (x, y) == tuple(GOAL))
    np.testing.assert_array_equal(straight_way(stuck, GOAL), GOAL[None])
    assert winding_way(stuck, GOAL[None], rng) is None
