"""Joint values merged from several publishers: how old they are, and whether they are at rest."""

from __future__ import annotations

import math
import threading
from collections.abc import Collection, Iterable, Mapping, Sequence
from math import isfinite

from placement_planner_ros.core.errors import JointStateError, PlacementPlannerError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.joint_past import WINDOW_S, JointPast, Sample

PUBLISH = "publish these joints too, or set assumed_joints"
"""What to do about joints that nobody publishes."""


class JointsStaleError(PlacementPlannerError):
    """Joint values are older than joint_state_timeout."""

    code = "JOINTS_STALE"


class RobotMovingError(PlacementPlannerError):
    """Joints are not at rest."""

    code = "ROBOT_MOVING"


class JointStates:
    """The newest value of each joint, and what it did lately. Safe to use from several threads.

    How old a value is is told by a steady clock, passed in as `now`, whatever clocks the stamps are
    of. A value whose stamp is older than that of one before it counts only where nothing newer came
    within `joint_past.WINDOW_S`: then that clock was set back.

    The past of a joint without end stops is kept in turns that go on from each other, whatever
    turns its values are reported in: one that rests where they wrap is at rest.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._continuous: frozenset[str] = frozenset()
        self._newest: dict[str, float] = {}
        self._heard_at: dict[str, float] = {}
        self._past: dict[str, JointPast] = {}

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
        # what is good of a message is taken before the rest is told
        taken, bad = _positions(names, positions)
        with self._lock:
            for name, position in taken.items():
                self._take(name, position, now if stamp is None else stamp, now)
        if bad is not None:
            raise bad

    def keep(self, names: Collection[str], continuous: Collection[str] = ()) -> None:
        """Forget every other joint.

        Args:
            continuous: those of them that have no end stops.
        """
        with self._lock:
            self._continuous = frozenset(continuous)
            for known in (self._newest, self._heard_at, self._past):
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
        """Where joints were at a stamp, rad or m: where they are now, if they have rested since.

        Args:
            stamp: of a cloud, say; None: at rest now.
            timeout: age from which on a value is stale, seconds.
            rest_speed: rad/s or m/s up to which a joint is at rest.
            assumed: values of joints that nobody publishes.

        Raises:
            JointStateError: a joint has never been heard of.
            JointsStaleError: a value is too old.
            RobotMovingError: a joint has moved since.
        """
        with self._lock:
            pasts = {name: self._past[name] for name in joints if name in self._past}
            missing = [name for name in joints if name not in pasts and name not in assumed]
            if missing:
                raise JointStateError("joint_states: missing", missing, PUBLISH)
            # an old value says nothing of where the joint was at the stamp
            self._require_fresh(pasts, now, timeout)
            # moving now, or not at rest for all the time since the stamp
            moved = [
                name
                for name, past in pasts.items()
                if past.moves(rest_speed) or (stamp is not None and not past.rested_since(stamp))
            ]
            if moved:
                raise RobotMovingError(
                    "joint_states: moved since then",
                    moved,
                    "publish clouds from where the sensor stands still, stamped by the clock of "
                    "the joint states",
                )
            return {n: pasts[n].newest.position if n in pasts else assumed[n] for n in joints}

    def moving(self, joints: Iterable[str], rest_speed: float) -> list[str]:
        """Those of these joints that are faster than that, rad/s or m/s."""
        with self._lock:
            return [n for n in joints if n in self._past and self._past[n].moves(rest_speed)]

    def positions(self) -> dict[str, float]:
        """Newest value of each joint as it was reported, rad or m."""
        with self._lock:
            return dict(self._newest)

    def age(self, now: float) -> float:
        """Seconds since any joint was heard of; infinite before the first."""
        with self._lock:
            return now - max(self._heard_at.values(), default=-math.inf)

    def stale(self, joints: Iterable[str], now: float, timeout: float) -> dict[str, float]:
        """Those of these joints whose newest value is older than `timeout`, with its age; seconds.

        Joints that have never been heard of are none of them.
        """
        with self._lock:
            ages = {n: now - self._heard_at[n] for n in joints if n in self._heard_at}
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
        # before motion is looked at, of which an old value tells nothing
        self._require_fresh({*robot.needed_joints, *matter}, now, timeout)
        moving = self.moving(matter, rest_speed)
        if moving:
            words = (
                f"start when the robot is at rest: no joint faster than rest_speed = {rest_speed:g}"
            )
            raise RobotMovingError("joint_states", moving, words)
        return q

    def _take(self, name: str, position: float, stamp: float, now: float) -> None:
        """Take in a joint's value, unless a newer one is known; lock held."""
        past = self._past.get(name)
        # older than the newest one: it comes late, or its clock was set back
        if past is not None and stamp < past.newest.time:
            if now - self._heard_at[name] < WINDOW_S:
                return  # it comes late
            past = None
        turned = position
        # the turn that is nearest to the value before, so that a wrap is no motion
        if past is not None and name in self._continuous:
            last = past.newest.position
            turned = last + math.remainder(position - last, 2.0 * math.pi)
        sample = Sample(stamp, turned)
        if past is None:
            self._past[name] = JointPast(sample)
        else:
            past.add(sample)
        self._newest[name], self._heard_at[name] = position, now

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
    # of a name given twice the last value was taken, which another one contradicts
    bad = {n for n, p in zip(names, positions, strict=True) if not isfinite(p) or taken[n] != p}
    if not bad:
        return taken, None
    field = "joint_states: not finite, or named twice with different positions"
    words = "publish one finite position per joint; the other joints' were taken"
    error = JointStateError(field, sorted(bad), words)
    return {name: p for name, p in taken.items() if name not in bad}, error
