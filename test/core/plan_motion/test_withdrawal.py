"""Ways out of narrow places, for an object that a point with three sliding joints carries."""

import itertools
from types import SimpleNamespace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.plan_motion.withdrawal import WindingTree


def in_slot(a, b):
    """Free in a slot of 4 mm that turns off to the side after 60 mm, where it is half as wide."""
    x, y, z = (a + np.linspace(0.0, 1.0, 100)[:, None] * (b - a)).T
    first = (np.abs(y) <= 0.002) & (x >= 0.0) & (x <= 0.062)
    second = (np.abs(x - 0.06) <= 0.001) & (y >= -0.002)
    return bool(((first | second) & (np.abs(z) <= 0.002)).all())


def test_a_winding_way_leads_out_of_a_slot_of_millimetres():
    holding = SimpleNamespace(chain=SimpleNamespace(fixed=np.eye(4)[None]), upright=None)
    holding.held = SimpleNamespace(body=SimpleNamespace(vertices=np.full((1, 3), 0.05)))
    holding.object_pose = lambda q: pin.SE3(np.eye(3), q)
    holding.tip_pose, holding.may_pass = (lambda T: np.eye(4)), lambda T: T[:, 0, 3] > -0.01
    holding.follow, holding.transit_free = (lambda T, _: T.translation), in_slot
    tree, rng = WindingTree(holding, np.zeros(3)), np.random.default_rng(0)
    asked, grown, ways = [], [], []
    closed = SimpleNamespace(**vars(holding))
    closed.may_pass = lambda T: asked.append(T) or np.zeros(len(T), np.bool_)
    shut = WindingTree(closed, np.zeros(3))
    while tree.pace and len(grown) < 300:
        grown.append(max(shut, tree, key=lambda one: one.pace))
        ways += [way for way in [grown[-1].grow(rng)] if way is not None]
    assert 0 < grown.count(shut) < len(grown) / 3, "what comes out comes first"
    most = np.minimum(np.arange(1, grown.count(shut) + 1), 22)
    assert [len(T) for T in asked[3:]] == np.repeat(most, most).tolist(), "few at first, at once"
    assert all(in_slot(a, b) for way in ways for a, b in itertools.pairwise(way))
    out = [np.linalg.norm(way[-1]) for way in ways]
    assert out == sorted(out), "further out than all before"
    assert out[-1] > 0.3
