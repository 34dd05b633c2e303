"""The movable joints of a robot: their names, limits and ties, and values of all of them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np

from placement_planner_ros.core.errors import JointStateError, RobotError, StartError
from placement_planner_ros.core.robot.joints import Mimic
from placement_planner_ros.core.types import ROUNDING, Array, Mask, frozen_array


@dataclass(frozen=True, slots=True, eq=False)
class JointSpace:
    """Joints, each with one coordinate: a configuration q is (nq,), in the order of `joint_names`.

    Attributes:
        joint_names: (nq) movable joints, mimicking ones included.
        lower, upper: (nq,) joint limits, rad or m; those of joints without end stops hold for
            plans alone (`joints.CONTINUOUS_RANGE`).
        velocity_limits: (nq,) rad/s or m/s.
        acceleration_limits: (nq,) rad/s² or m/s².
        mimics: joints that follow another.
        continuous: joints without end stops, which may have been turned any number of times.
        prismatic: joints that slide.
    """

    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity_limits: Array
    acceleration_limits: Array
    mimics: Mapping[str, Mimic]
    continuous: frozenset[str]
    prismatic: frozenset[str]

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "velocity_limits", "acceleration_limits"):
            array = frozen_array(getattr(self, name), (len(self.joint_names),))
            object.__setattr__(self, name, array)

    def index(self, joint: str) -> int:
        """Coordinate of a joint in q.

        Raises:
            RobotError: no movable joint of that name.
        """
        if joint not in self.joint_names:
            raise RobotError("joint", joint, f"name one of {list(self.joint_names)}")
        return self.joint_names.index(joint)

    @property
    def coupled(self) -> set[str]:
        """Joints that follow another, and those that are followed."""
        return {*self.mimics, *(mimic.master for mimic in self.mimics.values())}

    def with_positions(self, q: Array, positions: Mapping[str, float]) -> Array:
        """A copy of q (nq,) with some joints set; mimicking joints follow their masters, whatever
        is given for them.

        Raises:
            RobotError: no movable joint of that name.
            JointStateError: a value is not finite.
        """
        # Finite numbers only, then what follows.
        bad = [
            f"{n} = {v!r}"
            for n, v in positions.items()
            if not (isinstance(v, Real) and math.isfinite(v))
        ]
        if bad:
            raise JointStateError("`q_start`: values", bad, "must be finite numbers")
        q = np.array(q, dtype=np.float64)
        for name, value in positions.items():
            q[self.index(name)] = value
        for name, mimic in self.mimics.items():
            q[self.index(name)] = mimic.multiplier * q[self.index(mimic.master)] + mimic.offset
        return q

    def unwound(self, q: Array) -> Array:
        """q (nq,), continuous joints turned by whole turns to within half a turn of zero.

        A plan begins there. Coupled joints stay as they are.
        """
        # Whole turns of joints that are tied to none.
        endless = np.isin(self.joint_names, list(self.continuous - self.coupled))
        return np.asarray(q - np.where(endless, 2.0 * np.pi * np.round(q / (2.0 * np.pi)), 0.0))

    def apart(self, a: Array, b: Array) -> Array:
        """(nq,) how far each joint is from a to b, (nq,) both; continuous ones the shorter way.

        0 for joints that follow others, which may do so at another pace.
        """
        # Of joints without end stops without whole turns.
        away = np.abs(a - b)
        endless = np.isin(self.joint_names, list(self.continuous))
        wrapped = np.abs(away - 2.0 * np.pi * np.round(away / (2.0 * np.pi)))
        following = np.isin(self.joint_names, list(self.mimics))
        return np.where(following, 0.0, np.where(endless, wrapped, away))

    def require_plausible(self, q: Array, joints: Collection[str]) -> None:
        """Refuse a configuration q (nq,) in which one of these joints is further beyond its limits
        than it can move between them, as in another unit.

        Raises:
            StartError: there is one.
        """
        ranges = self.upper - self.lower
        far = (self._beyond(q) > ranges) & (ranges > 0.0) & np.isin(self.joint_names, list(joints))
        if far.any():
            words = self.limit_violations(np.where(far, q, self.lower))
            raise StartError("`q_start`", words, "more than it can move: publish rad or m")

    def within_limits(self, q: Array, tolerance: float) -> Array:
        """A copy of q (nq,) in which what is beyond a limit by no more than that is at the limit.

        Args:
            tolerance: rad or m.
        """
        near = self._beyond(q) <= tolerance + ROUNDING
        return np.where(near & self._has_limits, np.clip(q, self.lower, self.upper), q)

    @property
    def _has_limits(self) -> Mask:
        """(nq,) of joints with end stops; a mimicking one follows its master, whatever its own."""
        return ~np.isin(self.joint_names, [*self.continuous, *self.mimics])

    def _beyond(self, q: Array) -> Array:
        """(nq,) by how much each joint of q (nq,) is beyond its limits, rad or m; 0 inside."""
        beyond = np.maximum(np.maximum(self.lower - q, q - self.upper), 0.0)
        return np.where(self._has_limits, beyond, 0.0)

    def limit_violations(self, q: Array) -> list[str]:
        """One sentence per joint of q (nq,) that is beyond its limits."""
        within = np.where(self._has_limits, q, self.lower)
        return limit_violations(self.joint_names, within, self.lower, self.upper)


def limit_violations(joints: Sequence[str], q: Array, lower: Array, upper: Array) -> list[str]:
    """One sentence per joint of q (n,) that is beyond its limits, and how far."""
    beyond = np.maximum(lower - q, q - upper)
    return [
        f"joint {joints[i]} = {q[i]:.6g} is {beyond[i]:.4g} beyond its limits [{lower[i]:.6g}, "
        f"{upper[i]:.6g}]"
        for i in np.flatnonzero(beyond > ROUNDING).tolist()
    ]
