"""Ways that draw the held object out of a goal, with which a backward tree begins.

In shelves and between neighbours this is what random growth of joint angles takes longest to find.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.grasp.straight_down import UP
from placement_planner_ros.core.motion.birrt import branch_of
from placement_planner_ros.core.types import Array

_WAYPOINT_STEP_M = 0.03
"""m, between the waypoints."""
_DRAWN_OUT_M = 0.3
"""m from the goal, where the object counts as drawn out; straight ways go a waypoint further, since
they may fall short by rounding, winding ones half as far in one direction."""
_MOST_DIRECTIONS = 22
"""Directions that a tree tries at once, and how many times in one call, at most."""
_SMALLEST_STEP = 0.03
"""Of the step between waypoints, the smallest of a winding way: a millimetre."""
_SPREAD_SHARE = 0.3
"""Of the directions, those from the node that is nearest to a random pose."""
_SPREAD_M = 0.1
"""Standard deviation of such a pose from that of a node, at most."""


class WindingTree:
    """Free ways of the object out of a goal, straight ones first, then winding ones.

    Straight ones lead towards the arm's base, upwards, and against the hand's pointing direction.
    Then it is an RRT in the space of object poses: its nodes move in random directions, inwards
    rather than outwards, turning or not, or much as they came, from the node that is furthest out
    or from the one nearest to a random pose, so that it spreads to where it has not been.

    Args:
        q: (dof,) the goal.
    """

    def __init__(self, holding: Holding, q: Array) -> None:
        self._holding = holding
        # How far what is furthest from the object's origin is from there.
        self._size = float(np.linalg.norm(holding.held.body.vertices, axis=1).max())
        self._nodes, self._parents = [q], [-1]
        self._places = self._place(q)[None]
        # The direction, of unit length, and the turn by which each was come to; zeros for the
        # straight ways, from which all directions are drawn anew.
        self._ways = np.zeros((1, 6))
        # The node that is furthest out so far, and how far that is.
        self._best, self._out = 0, 0.0
        T = holding.object_pose(q)
        inwards = (holding.chain.fixed[0, :3, 3] - T.translation) * (1.0, 1.0, 0.0)
        self._inwards = np.append(inwards / max(float(np.linalg.norm(inwards)), 1e-6), np.zeros(3))
        for way in (self._inwards[:3], UP, -holding.tip_pose(T)[:3, 2]):
            if self._out < _DRAWN_OUT_M:
                step, most = _WAYPOINT_STEP_M * way, _DRAWN_OUT_M + _WAYPOINT_STEP_M
                self._go(0, step, np.eye(3), self._ways[0], most)
        self._begun, self._calls = self._out - _SMALLEST_STEP * _WAYPOINT_STEP_M, 0

    @property
    def pace(self) -> float:
        """m gained beyond the straight ways, and the smallest step, for each call and one more; 0
        where the object is out, or there are more nodes than are worth it."""
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
        calls, as most goals can be left without, and k times k in the k-th, up to a limit.

        Args:
            should_stop: asked each time before directions are tried; True ends the call.

        Returns:
            None where the object is out already, or no way further out is found.
        """
        before = self._out
        self._calls += 1
        count = min(self._calls, _MOST_DIRECTIONS)
        for _ in range(count):
            if not self.pace or should_stop():
                break
            self._try(count, rng)
        return self.way if self._out > before else None

    def _try(self, count: int, rng: np.random.Generator) -> None:
        """Go on from nodes that there are in so many directions."""
        # From the node that is furthest out, or from those nearest to a place beside another.
        places, of_pose = self._places, self._places.shape[1]
        aside = rng.random((count, 1)) * _SPREAD_M * rng.standard_normal((count, of_pose))
        aims = places[rng.integers(len(places), size=count)] + aside
        nearest = (0.5 * (places**2).sum(axis=1) - aims @ places.T).argmin(axis=1)
        starts = np.where(rng.random(count) < _SPREAD_SHARE, nearest, self._best)
        # Directions, inwards rather than outwards, and half of the time a turn.
        along = rng.standard_normal((count, 6)) + self._inwards
        along[rng.random(count) < 0.5, 3:] = 0.0
        if self._holding.upright is not None:
            along[:, 3:5] = 0.0  # about the vertical, which tilts nothing
        # Half of the time much the way that the node was come to: in pockets it leads on.
        on = rng.random(count) < 0.5
        along[on] = self._ways[starts[on]] + 0.5 * along[on]
        along[:, :3] /= np.maximum(np.linalg.norm(along[:, :3], axis=1, keepdims=True), 1e-6)
        # Steps of all sizes, as pockets are left in millimetres; by a turn what is furthest from
        # the origin moves about as far.
        sizes = _WAYPOINT_STEP_M * _SMALLEST_STEP ** rng.random((count, 1))
        steps = sizes * along[:, :3]
        turns = np.array([pin.exp3(turn) for turn in sizes / self._size * along[:, 3:]])
        # Where each first step leads to: most end where the hand or what it holds collides.
        T = np.tile(np.eye(4), (count, 1, 1))
        T[:, :3, :3] = turns @ places[starts, 3:].reshape(-1, 3, 3) / self._size
        T[:, :3, 3] = places[starts, :3] + steps
        for k in np.flatnonzero(self._holding.may_pass(T)).tolist():
            self._go(int(starts[k]), steps[k], turns[k], along[k], 0.5 * _DRAWN_OUT_M)

    def _go(self, start: int, step: Array, turn: Array, along: Array, length: float) -> None:
        """Go on from a node as far as that is free, for as many waypoints as a length in metres
        has: the object moves by `step` (3,) and turns by `turn` (3, 3) about its origin to the
        first one, twice as much to each further one until it moves as far as between others."""
        holding, last = self._holding, start
        T = holding.object_pose(self._nodes[start])
        for _ in range(round(length / _WAYPOINT_STEP_M)):
            # As long as the hand may pass, the arm follows, and is free.
            T, q = pin.SE3(turn @ T.rotation, T.translation + step), self._nodes[last]
            q_next = holding.follow(T, q) if holding.may_pass(T.homogeneous[None]) else None
            if q_next is None or not holding.transit_free(q, q_next):
                break
            self._parents.append(last)
            last = len(self._nodes)
            self._nodes.append(q_next)
            self._places = np.vstack([self._places, self._place(q_next)])
            self._ways = np.vstack([self._ways, along])
            if np.linalg.norm(step) <= 0.5 * _WAYPOINT_STEP_M:
                step, turn = 2.0 * step, turn @ turn
        # Whether it has come further out than all others.
        reached = float(np.linalg.norm((self._places[last] - self._places[0])[:3]))
        if reached > self._out:
            self._best, self._out = last, reached

    def _place(self, q: Array) -> Array:
        """(12,) m, where the object is at `q`: its origin, and its axes, as long as it is large."""
        T = self._holding.object_pose(q)
        return np.concatenate([T.translation, self._size * T.rotation.ravel()])
