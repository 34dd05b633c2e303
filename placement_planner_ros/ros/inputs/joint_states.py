"""Joint values merged from several publishers: how old they are, and whether they are at rest."""

from __future__ import annotations

import math
import threading
from collections.abc import Collection, Iterable, Mapping, Sequence
from math import isfinite

from placement_planner_ros.core.errors import JointStateError, PlacementPlannerError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.joint_past import HISTORY_S, WINDOW_S, JointPast, Sample

PUBLISH = "publish these joints too, or set assumed_joints"
"""What to do about joints that nobody publishes."""


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
    it is the newest only where nothing newer came within `joint_past.WINDOW_S`: then that clock
    was set back.

    The past of a joint without end stops is kept in turns that go on from each other, whatever
    turns its values are reported in: one that rests where they wrap is at rest.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._continuous: frozenset[str] = frozenset()
        self._newest: dict[str, float] = {}
        self._heard: dict[str, JointPast] = {}  # by the steady clock
        self._past: dict[str, JointPast] = {}  # by the stamps

    def update(
        self,
        names: Sequence[str],
        positions: Sequence[float],
        now: float,
        stamp: float | None = None,
    ) -> None:
        """Take in one message.

        Args:
            stamp: of the values, seconds of the clock that stamps clouds; None: `now`.

        Raises:
            JointStateError: lengths differ, and nothing is taken; or a position is not finite, or
                a joint is named twice with different ones, and the other joints are taken.
        """
        taken, bad = _positions(names, positions)
        with self._lock:
            for name, position in taken.items():
                turned = self._going_on(name, position)
                sample = Sample(now if stamp is None else stamp, turned)
                if self._is_newest(name, sample, now):
                    self._newest[name] = position
                    self._heard.setdefault(name, JointPast()).add(Sample(now, turned))
        if bad is not None:
            raise bad

    def keep(self, names: Collection[str], continuous: Collection[str] = ()) -> None:
        """Forget every other joint.

        Args:
            continuous: those of them that have no end stops.
        """
        with self._lock:
            self._continuous = frozenset(continuous)
            for known in (self._newest, self._heard, self._past):
                for name in [name for name in known if name not in names]:
                    del known[name]

    def at(
        self,
        joints: Sequence[str],
        stamp: float | None,
        now: float,
        timeout: float,
        rest_speed: float,
        assumed: Mapping[str, float],
    ) -> dict[str, float]:
        """Where joints were at a stamp, rad or m.

        Where that is not known, as without a stamp, it is where they are now, if they have been at
        rest since.

        Args:
            timeout: age from which on what is newest now is stale, seconds.
            rest_speed: rad/s or m/s up to which a joint is at rest.
            assumed: values of joints that nobody publishes.

        Raises:
            JointStateError: a joint has never been heard of.
            JointsStaleError: the newest value is older than the stamp, and too old.
            RobotMovingError: a joint moved, and where it was is not known.
        """
        with self._lock:
            pasts = {name: self._past[name] for name in joints if name in self._past}
            missing = [name for name in joints if name not in pasts and name not in assumed]
            if missing:
                raise JointStateError("joint_states: missing", missing, PUBLISH)
            self._require_fresh(
                [n for n, past in pasts.items() if stamp is None or stamp > past.newest],
                now,
                timeout,
            )
            values = {name: past.at(stamp, rest_speed) for name, past in pasts.items()}
        unknown = [name for name, value in values.items() if value is None]
        if unknown:
            when = "without a stamp" if stamp is None else "then"
            raise RobotMovingError(
                "joint_states: where the joints were",
                unknown,
                f"is not known {when}, and they moved; known are the last {HISTORY_S:g} s of "
                "stamps: stamp clouds and joint states by the same clock, or keep the robot still",
            )
        known = {name: value for name, value in values.items() if value is not None}
        return {name: known.get(name, assumed.get(name, 0.0)) for name in joints}

    def moving(self, joints: Iterable[str], stamp: float | None, rest_speed: float) -> list[str]:
        """Those of these joints that were faster than that at a stamp; without one, are now."""
        with self._lock:
            pasts = self._heard if stamp is None else self._past
            return [
                name
                for name in joints
                if (past := pasts.get(name)) is not None
                and past.moves(past.newest if stamp is None else stamp, rest_speed)
            ]

    def positions(self) -> dict[str, float]:
        """Newest value of each joint as it was reported, rad or m."""
        with self._lock:
            return dict(self._newest)

    def age(self, now: float) -> float:
        """Seconds since any joint was heard of; infinite before the first."""
        with self._lock:
            return now - max((each.newest for each in self._heard.values()), default=-math.inf)

    def stale(self, joints: Iterable[str], now: float, timeout: float) -> dict[str, float]:
        """Those of these joints whose newest value is older than `timeout`, with its age; seconds.

        Joints that have never been heard of are none of them.
        """
        with self._lock:
            ages = {n: now - self._heard[n].newest for n in joints if n in self._heard}
        return {name: age for name, age in ages.items() if age > timeout}

    def resting(
        self,
        robot: Robot,
        matter: Collection[str],
        assumed: Mapping[str, float],
        now: float,
        timeout: float,
        rest_speed: float,
    ) -> Array:
        """q_0 (nq,), complete, fresh, and at rest as far as that matters.

        Args:
            matter: joints that must be known and at rest.
            assumed: values of joints that nobody publishes, rad or m.
            timeout: age from which on a value is stale, seconds.
            rest_speed: rad/s or m/s up to which a joint is at rest.

        Raises:
            JointStateError: a joint that must be known has never been heard of.
            JointsStaleError: its value is too old.
            RobotMovingError: a joint that matters is moving.
        """
        try:
            q = robot.configuration({**assumed, **self.positions()}, matter)
        except JointStateError as error:
            raise JointStateError(error.field, error.value, PUBLISH) from None
        self._require_fresh({*robot.needed_joints, *matter}, now, timeout)
        moving = self.moving(matter, None, rest_speed)
        if moving:
            words = (
                f"start when the robot is at rest: no joint faster than rest_speed = {rest_speed:g}"
            )
            raise RobotMovingError("joint_states", moving, words)
        return q

    def _going_on(self, name: str, position: float) -> float:
        """A position in the turn next to the newest of a joint without end stops. Lock held."""
        if name not in self._continuous or name not in self._heard:
            return position
        last = self._heard[name].latest
        return last + math.remainder(position - last, 2.0 * math.pi)

    def _is_newest(self, name: str, sample: Sample, now: float) -> bool:
        """Remember a value; whether it is the joint's newest. Lock held."""
        past = self._past.get(name)
        if past is None:
            past = self._past[name] = JointPast()
        late = sample.time < past.newest
        if late and now - self._heard[name].newest >= WINDOW_S:
            late = False
            past.forget()
        past.add(sample)
        return not late

    def _require_fresh(self, joints: Iterable[str], now: float, timeout: float) -> None:
        """Raise a JointsStaleError that names what is older than `timeout` seconds."""
        stale = {name: f"{age:.1f} s" for name, age in self.stale(joints, now, timeout).items()}
        if stale:
            words = f"no value within joint_state_timeout = {timeout:g} s"
            raise JointsStaleError("joint_states: ages", stale, words)


def _positions(
    names: Sequence[str], positions: Sequence[float]
) -> tuple[dict[str, float], JointStateError | None]:
    """Which values of one message can be taken, and what is wrong with the others."""
    if len(positions) != len(names):
        words = f"{len(names)} names, {len(positions)} positions"
        return {}, JointStateError("joint_states", words, "publish one position per name")
    taken = dict(zip(names, positions, strict=True))
    bad = {n for n, p in zip(names, positions, strict=True) if not isfinite(p) or taken[n] != p}
    if not bad:
        return taken, None
    field = "joint_states: not finite, or named twice with different positions"
    words = "publish one finite position per joint; the other joints' were taken"
    error = JointStateError(field, sorted(bad), words)
    return {name: p for name, p in taken.items() if name not in bad}, error
