"""Joint values merged from several publishers: how old they are, and whether they are at rest."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Collection, Iterable, Sequence

from placement_planner_ros.core.errors import JointStateError, PlacementPlannerError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.joint_past import HISTORY, REST_SPEED, JointPast, Sample

REST_WINDOW = 0.3
"""Seconds over which a joint at rest must have stayed where it is."""


class JointsStaleError(PlacementPlannerError):
    """Joint values are older than joint_state_timeout."""

    code = "JOINTS_STALE"


class RobotMovingError(PlacementPlannerError):
    """Joints are not at rest."""

    code = "ROBOT_MOVING"


class JointStates:
    """The newest value of each joint, and where it was before. Safe to use from several threads.

    How old a value is and whether the robot is at rest is told by a steady clock, passed in as
    `now`, whatever clocks the stamps are of. A value whose stamp is older than that of one before
    it is the newest only where nothing newer came within `REST_WINDOW`: then that clock was set
    back.

    The past of a joint without end stops is kept in turns that go on from each other, whatever
    turns its values are reported in: one that rests where they wrap is at rest.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._continuous: frozenset[str] = frozenset()
        self._newest: dict[str, float] = {}
        self._history: dict[str, deque[tuple[float, float]]] = {}
        self._velocity: dict[str, float] = {}
        self._past: dict[str, JointPast] = {}
        self._refused: tuple[float, str] = (-math.inf, "")

    def update(
        self,
        names: Sequence[str],
        positions: Sequence[float],
        velocities: Sequence[float],
        now: float,
        stamp: float | None = None,
    ) -> None:
        """Take in one message; velocities may be empty.

        Args:
            stamp: of the values, seconds of the clock that stamps clouds; None: `now`.

        Raises:
            JointStateError: lengths differ, and nothing is taken; or a position is not finite, or
                a joint is named twice with different ones, and the other joints are taken.
        """
        taken, bad = _positions(names, positions)
        with self._lock:
            if bad is not None:
                self._refused = now, str(bad)
            for i in taken:
                name, position = names[i], positions[i]
                velocity = velocities[i] if i < len(velocities) else 0.0
                velocity = velocity if math.isfinite(velocity) else 0.0
                turned = self._going_on(name, position)
                sample = Sample(now if stamp is None else stamp, turned, velocity)
                if not self._is_newest(name, sample, now):
                    continue
                self._newest[name] = position
                history = self._history.setdefault(name, deque())
                history.append((now, turned))
                # One value from before the window stays: where the joint was when it began.
                while len(history) > 1 and history[1][0] <= now - REST_WINDOW:
                    history.popleft()
                self._velocity[name] = velocity
        if bad is not None:
            raise bad

    def keep(self, names: Collection[str], continuous: Collection[str] = ()) -> None:
        """Forget every other joint.

        Args:
            continuous: those of them that have no end stops.
        """
        with self._lock:
            self._continuous = frozenset(continuous)
            for known in (self._newest, self._history, self._velocity, self._past):
                for name in [name for name in known if name not in names]:
                    del known[name]

    def at(
        self, joints: Sequence[str], stamp: float | None, now: float, timeout: float
    ) -> dict[str, float]:
        """Where joints were at a stamp, rad or m.

        Where that is not known, as without a stamp, it is where they are now, if they have been at
        rest since.

        Args:
            timeout: age from which on what is newest now is stale, seconds.

        Raises:
            JointStateError: a joint has never been heard of.
            JointsStaleError: the newest value is older than the stamp, and too old.
            RobotMovingError: a joint moved, and where it was is not known.
        """
        with self._lock:
            missing = [name for name in joints if name not in self._past]
            if missing:
                raise JointStateError("joint_states: missing", missing, "publish these joints too")
            pasts = {name: self._past[name] for name in joints}
            self._require_fresh(
                [n for n, past in pasts.items() if stamp is None or stamp > past.newest],
                now,
                timeout,
            )
            values = {name: past.at(stamp) for name, past in pasts.items()}
        unknown = [name for name, value in values.items() if value is None]
        if unknown:
            when = "without a stamp" if stamp is None else "then"
            raise RobotMovingError(
                "joint_states: where the joints were",
                unknown,
                f"is not known {when}, and they moved; what is known are the last {HISTORY:g} s of "
                "stamps: stamp clouds and joint states by the same clock, or keep the robot still",
            )
        return {name: value for name, value in values.items() if value is not None}

    def moving(self, joints: Sequence[str], stamp: float | None) -> list[str]:
        """Those of these joints that were moving at a stamp; without one, that are now."""
        with self._lock:
            pasts = {name: self._past[name] for name in joints if name in self._past}
            return [
                name
                for name, past in pasts.items()
                if past.moves(past.newest if stamp is None else stamp)
            ]

    def positions(self) -> dict[str, float]:
        """Newest value of each joint as it was reported, rad or m."""
        with self._lock:
            return dict(self._newest)

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
        try:
            q = robot.configuration(self.positions())
        except JointStateError as error:
            remedy = f"{error.remedy}{self._refusal(now, timeout)}"
            raise JointStateError(error.field, error.value, remedy) from None
        needed = [name for name in robot.joint_names if name not in robot.mimics]
        with self._lock:
            gone = [name for name in needed if name not in self._newest]
            if gone:  # meanwhile, as another robot has come
                raise JointStateError("joint_states: missing", gone, "publish these joints too")
            self._require_fresh(needed, now, timeout)
            moving = [
                name
                for name in needed
                if abs(self._velocity[name]) > REST_SPEED
                or _spread(self._history[name], now - REST_WINDOW) > tolerance
            ]
        if moving:
            raise RobotMovingError("joint_states", moving, "start when the robot is at rest")
        return q

    def _going_on(self, name: str, position: float) -> float:
        """A position in the turn next to the newest of a joint without end stops. Lock held."""
        if name not in self._continuous or name not in self._history:
            return position
        last = self._history[name][-1][1]
        return last + math.remainder(position - last, 2.0 * math.pi)

    def _is_newest(self, name: str, sample: Sample, now: float) -> bool:
        """Remember a value; whether it is the joint's newest. Lock held."""
        past = self._past.get(name)
        if past is None:
            past = self._past[name] = JointPast()
        late = sample.stamp < past.newest
        if late and now - self._history[name][-1][0] >= REST_WINDOW:
            late = False
            past.forget()
        past.add(sample)
        return not late

    def _require_fresh(self, joints: Iterable[str], now: float, timeout: float) -> None:
        """Lock held; a JointsStaleError names what is older than `timeout` seconds."""
        ages = {name: now - self._history[name][-1][0] for name in joints}
        stale = {name: f"{age:.1f} s" for name, age in ages.items() if age > timeout}
        if stale:
            words = f"no value within joint_state_timeout = {timeout:g} s"
            words += self._refusal(now, timeout)
            raise JointsStaleError("joint_states: ages", stale, words)

    def refused(self, now: float, timeout: float) -> str:
        """What was wrong with the newest bad message of that many seconds; '' without one."""
        when, why = self._refused
        return why if now - when <= timeout else ""

    def _refusal(self, now: float, timeout: float) -> str:
        """What to add where values are missing, as messages came but were refused."""
        why = self.refused(now, timeout)
        return f"; of what came, some was refused: {why}" if why else ""


def _spread(history: deque[tuple[float, float]], since: float) -> float:
    """How far a joint moved since then, from where it was at that time."""
    values = [position for time, position in history if time >= since]
    values += [position for time, position in history if time < since][-1:]
    return max(values) - min(values)


def _positions(
    names: Sequence[str], positions: Sequence[float]
) -> tuple[list[int], JointStateError | None]:
    """Which values of one message can be taken, and what is wrong with the others."""
    if len(positions) != len(names):
        return [], JointStateError(
            "joint_states",
            f"{len(names)} names, {len(positions)} positions",
            "publish one position per name",
        )
    first: dict[str, float] = {}
    told = list(enumerate(zip(names, positions, strict=True)))
    unknown = {name for _, (name, position) in told if not math.isfinite(position)}
    twice = {name for _, (name, p) in told if first.setdefault(name, p) != p} - unknown
    taken = [i for i, (name, _) in told if name not in unknown and name not in twice]
    if unknown:
        words = "publish finite positions; the other joints' were taken"
        return taken, JointStateError("joint_states: not finite", sorted(unknown), words)
    if twice:
        words = "name each joint once; the other joints' positions were taken"
        field = "joint_states: named twice, with different positions"
        return taken, JointStateError(field, sorted(twice), words)
    return taken, None
