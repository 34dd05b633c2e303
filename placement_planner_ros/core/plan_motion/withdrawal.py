"""Ways that draw the held object out of a goal, with which a backward tree begins.

In shelves and between neighbours this is what random growth of joint angles takes longest to find.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.motion.birrt import branch_of
from placement_planner_ros.core.types import Array

_WAYPOINT_STEP_M = 0.03
"""m, between the waypoints."""
_DRAWN_OUT_M = 0.3
"""m from the goal, where the object counts as drawn out; of a winding way half as much is tried in
one direction."""
_TRIED_DIRECTIONS = 120
"""Directions that a tree tries in one call, at most."""
_SMALLEST_STEP = 0.03
"""Of the step between waypoints, the smallest of a winding way: a millimetre."""
_SPREAD_SHARE = 0.3
"""Of the directions, those from the node that is nearest to a random pose."""
_SPREAD_M = 0.1
"""Standard deviation of such a pose from that of a node, at most."""


def straight_way(holding: Holding, q: Array) -> Array:
    """(k, dof) the longest free straight way of the object, from `q` (dof,) on.

    Tried are towards the arm's base, upwards, and against the hand's pointing direction.
    """
    T_world_object = holding.object_pose(q)
    hand = holding.tip_pose(T_world_object)[:3, 2]
    best, most = [q], round(_DRAWN_OUT_M / _WAYPOINT_STEP_M)
    # The longest free way of the three.
    for direction in (_inward_direction(holding, T_world_object), np.array([0.0, 0.0, 1.0]), -hand):
        length = float(np.linalg.norm(direction))
        if length < 1e-6:
            continue
        step = direction * (_WAYPOINT_STEP_M / length)
        way = _straight_run(holding, q, step, np.eye(3), most)
        if len(way) > len(best):
            best = way
        if len(best) > most:
            break
    return np.array(best)


class WindingTree:
    """Free ways from branch[0] on that get the object further out than `branch` does.

    An RRT in the space of object poses: its nodes move in random directions, inwards rather than
    outwards, turning or not, or much as they came, from the node that is furthest out or from the
    one nearest to a random pose, so that it spreads to where it has not been.

    Args:
        branch: (m, dof) a free way from the goal on, which the tree begins with.
    """

    def __init__(self, holding: Holding, branch: Array) -> None:
        self._holding = holding
        self._nodes = list(branch)
        self._parents = list(range(-1, len(branch) - 1))
        inwards = _inward_direction(holding, holding.object_pose(branch[0]))
        inwards /= max(float(np.linalg.norm(inwards)), 1e-6)
        self._inwards = np.concatenate([inwards, np.zeros(3)])
        # How far what is furthest from the object's origin is from there.
        self._size = float(np.linalg.norm(holding.held.body.vertices, axis=1).max())
        self._places = [self._place(q) for q in branch]
        # The direction, of unit length, and the turn by which each was come to; zeros for the
        # branch, from which all directions are drawn anew.
        self._ways = [np.zeros(6) for _ in branch]
        # The end of the known way is the furthest out so far.
        self._best = len(branch) - 1
        self._out = self._distance(self._best)
        self._begun, self._calls = self._out - _SMALLEST_STEP * _WAYPOINT_STEP_M, 0

    @property
    def pace(self) -> float:
        """m gained beyond the known way, and the smallest step, for each call and one more; 0 where
        the object is out, or there are more nodes than are worth it."""
        done = self._out >= _DRAWN_OUT_M or len(self._nodes) > 10_000
        return 0.0 if done else (self._out - self._begun) / (1 + self._calls)

    @property
    def way(self) -> Array:
        """(k, dof) the free way that gets the object furthest out, from the goal on."""
        return np.array([self._nodes[node] for node in branch_of(self._parents, self._best)[::-1]])

    def grow(
        self, rng: np.random.Generator, should_stop: Callable[[], bool] = lambda: False
    ) -> Array | None:
        """(k, dof) a way further out than all before, after some more directions: few in the first
        calls, as most goals can be left without, and k² in the k-th, up to 120.

        Args:
            should_stop: asked before every direction; True ends the call.

        Returns:
            None where the object is out already, or no way further out is found.
        """
        nodes, before = self._nodes, self._out
        self._calls += 1
        run = round(0.5 * _DRAWN_OUT_M / _WAYPOINT_STEP_M)
        places = np.array(self._places)
        for _ in range(min(self._calls**2, _TRIED_DIRECTIONS)):
            if not self.pace or should_stop():
                break
            # From the node that is furthest out, or from the one nearest to a place beside another.
            last = self._best
            if rng.random() < _SPREAD_SHARE:
                aside = rng.random() * _SPREAD_M * rng.standard_normal(places.shape[1])
                aim = places[rng.integers(len(places))] + aside
                last = int(((places - aim) ** 2).sum(axis=1).argmin())
            # A direction, inwards rather than outwards, and half of the time a turn.
            along = rng.standard_normal(6) + self._inwards
            if rng.random() < 0.5:
                along[3:] = 0.0
            elif self._holding.upright is not None:
                along[3:5] = 0.0  # about the vertical, which tilts nothing
            # Half of the time much the way that the node was come to: in pockets it leads on.
            if rng.random() < 0.5:
                along = self._ways[last] + 0.5 * along
            along[:3] /= max(float(np.linalg.norm(along[:3])), 1e-6)
            # Steps of all sizes, as pockets are left in millimetres; by a turn what is furthest
            # from the origin moves about as far.
            size = _WAYPOINT_STEP_M * _SMALLEST_STEP ** rng.random()
            direction, turn = size * along[:3], pin.exp3(size / self._size * along[3:])
            # Go on as far as that is free.
            for q in _straight_run(self._holding, nodes[last], direction, turn, run)[1:]:
                self._parents.append(last)
                last = len(nodes)
                nodes.append(q)
                self._places.append(self._place(q))
                self._ways.append(along)
            # Whether it has come further out than all others.
            reached = self._distance(last)
            if reached > self._out:
                self._best, self._out = last, reached
        return self.way if self._out > before else None

    def _place(self, q: Array) -> Array:
        """(12,) m, where the object is at `q`: its origin, and its axes, as long as it is large."""
        T = self._holding.object_pose(q)
        return np.concatenate([T.translation, self._size * T.rotation.ravel()])

    def _distance(self, node: int) -> float:
        """Of the object's origin at a node from where it is at the goal, metres."""
        return float(np.linalg.norm(self._places[node][:3] - self._places[0][:3]))


def _inward_direction(holding: Holding, T_world_object: pin.SE3) -> Array:
    """(3,) horizontally from the object to the arm's base."""
    return np.array(holding.chain.fixed[0, :3, 3] - T_world_object.translation) * (1.0, 1.0, 0.0)


def _straight_run(holding: Holding, q: Array, step: Array, turn: Array, steps: int) -> list[Array]:
    """Configurations from `q` on, moving the object by `step` (3,) and turning it by `turn` (3, 3)
    about its origin to the first, twice as much to each further one until it moves as far as from
    waypoint to waypoint, as far as that is free."""
    way, T = [q], holding.object_pose(q)
    # From pose to pose, as long as the arm follows and is free.
    for _ in range(steps):
        T = pin.SE3(turn @ T.rotation, T.translation + step)
        q_next = holding.follow(T, way[-1])
        if q_next is None or not holding.transit_free(way[-1], q_next):
            break
        way.append(q_next)
        if np.linalg.norm(step) <= 0.5 * _WAYPOINT_STEP_M:
            step, turn = 2.0 * step, turn @ turn
    return way
