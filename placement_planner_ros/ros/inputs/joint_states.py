"""Joint values merged from several publishers: how old they are, and whether they are at rest."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Sequence

from placement_planner_ros.core.errors import JointStateError, PlacementPlannerError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array

REST_WINDOW = 0.3
"""Seconds over which a joint at rest must have stayed where it is."""

REST_SPEED = 0.02
"""rad/s or m/s; a joint that reports more is moving."""


class JointsStaleError(PlacementPlannerError):
    """Joint values are older than joint_state_timeout."""

    code = "JOINTS_STALE"


class RobotMovingError(PlacementPlannerError):
    """Joints are not at rest."""

    code = "ROBOT_MOVING"


class JointStates:
    """The newest value of each joint. Safe to use from several threads.

    Times are seconds of one steady clock, passed in.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._history: dict[str, deque[tuple[float, float]]] = {}
        self._velocity: dict[str, float] = {}

    def update(
        self,
        names: Sequence[str],
        positions: Sequence[float],
        velocities: Sequence[float],
        now: float,
    ) -> None:
        """Take in one message; velocities may be empty.

        Raises:
            JointStateError: lengths differ, or a position is not finite; nothing is taken then.
        """
        if len(positions) != len(names):
            raise JointStateError(
                "joint_states",
                f"{len(names)} names, {len(positions)} positions",
                "publish one position per name",
            )
        bad = [n for n, p in zip(names, positions, strict=True) if not math.isfinite(p)]
        if bad:
            raise JointStateError("joint_states: not finite", bad, "publish finite positions")
        with self._lock:
            for i, (name, position) in enumerate(zip(names, positions, strict=True)):
                history = self._history.setdefault(name, deque())
                history.append((now, position))
                # One value from before the window stays: where the joint was when it began.
                while len(history) > 1 and history[1][0] <= now - REST_WINDOW:
                    history.popleft()
                velocity = velocities[i] if i < len(velocities) else 0.0
                self._velocity[name] = velocity if math.isfinite(velocity) else 0.0

    def positions(self) -> dict[str, float]:
        """Newest value of each joint, rad or m."""
        with self._lock:
            return {name: history[-1][1] for name, history in self._history.items()}

    def age(self, now: float) -> float:
        """Seconds since any joint was heard of; infinite before the first."""
        with self._lock:
            newest = max((h[-1][0] for h in self._history.values()), default=-math.inf)
        return now - newest

    def resting(self, robot: Robot, now: float, timeout: float, tolerance: float) -> Array:
        """q_0 (nq,), complete, fresh and at rest.

        Args:
            timeout: age from which on a value is stale, seconds.
            tolerance: change within `REST_WINDOW` from which on a joint is moving, rad or m.

        Raises:
            JointStateError: a joint has never been heard of.
            JointsStaleError: a value is too old.
            RobotMovingError: a joint is moving.
        """
        q = robot.configuration(self.positions())
        needed = [name for name in robot.joint_names if name not in robot.mimics]
        with self._lock:
            ages = {name: now - self._history[name][-1][0] for name in needed}
            stale = {name: f"{age:.1f} s" for name, age in ages.items() if age > timeout}
            if stale:
                raise JointsStaleError(
                    "joint_states: ages",
                    stale,
                    f"no value within joint_state_timeout = {timeout:g} s",
                )
            moving = [
                name
                for name in needed
                if abs(self._velocity[name]) > REST_SPEED
                or _spread(self._history[name], now - REST_WINDOW) > tolerance
            ]
        if moving:
            raise RobotMovingError("joint_states", moving, "start when the robot is at rest")
        return q


def _spread(history: deque[tuple[float, float]], since: float) -> float:
    """How far a joint moved since then, from where it was at that time."""
    values = [position for time, position in history if time >= since]
    values += [position for time, position in history if time < since][-1:]
    return max(values) - min(values)
