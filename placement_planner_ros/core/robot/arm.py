"""An arm that could be holding the object: a chain of joints, a tip, grasps and a hand; and the
same as what moves while all else of its robot stands still."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.types import ROUNDING, Array, Index, frozen_array, frozen_integers

if TYPE_CHECKING:
    from placement_planner_ros.core.robot.model import Robot


def follow_masters(ties: Array, Q: Array) -> Array:
    """A copy of configurations Q (..., dof) in which tied joints follow; ties (k, 4) of an arm."""
    Q = np.array(Q, dtype=np.float64)
    for joint, other, factor, offset in ties.tolist():
        Q[..., int(joint)] = factor * Q[..., int(other)] + offset
    return Q


@dataclass(frozen=True, slots=True, eq=False)
class Arm:
    """One candidate arm, made by `Robot.arm`, which checks it; equal where all values are.

    Attributes:
        name: as the user calls it.
        tip_frame: link that the grasps refer to.
        joints: (dof) names, root to tip.
        grasps: T_tip_object, one per way of holding the object.
        touch_links: links that may touch the held object.
        gripper_joints: joints that open the hand.
        gripper_open: their values when open, rad or m.
        q_index: (dof,) coordinates of `joints` in the robot's q.
        lower, upper: (dof,) joint limits, rad or m.
        velocity: (dof,) velocity limits, rad/s or m/s.
        acceleration: (dof,) acceleration limits, rad/s² or m/s², stated or assumed.
        turnable: those of `joints` that turn two times around or more, or without end: what such
            a joint reaches it reaches in another turn, too.
        ties: (k, 4) a row for each joint that follows another one of the arm: its place in
            `joints`, that of the other, factor and offset. Of such joints limits fit each other.
    """

    name: str
    tip_frame: str
    joints: tuple[str, ...]
    grasps: tuple[pin.SE3, ...]
    touch_links: tuple[str, ...]
    gripper_joints: tuple[str, ...]
    gripper_open: tuple[float, ...]
    q_index: Index
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    turnable: tuple[str, ...] = ()
    ties: Array = field(default_factory=lambda: np.zeros((0, 4)))

    def __post_init__(self) -> None:
        object.__setattr__(self, "ties", frozen_array(self.ties, (len(self.ties), 4)))
        object.__setattr__(self, "q_index", frozen_integers(self.q_index))
        for name in ("lower", "upper", "velocity", "acceleration"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (self.dof,)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Arm) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    @property
    def used_joints(self) -> tuple[str, ...]:
        """Its joints and those of its hand."""
        return (*self.joints, *self.gripper_joints)

    @property
    def _content(self) -> tuple[Hashable, ...]:
        values = [getattr(self, each.name) for each in fields(self) if each.name != "grasps"]
        poses = (grasp.homogeneous for grasp in self.grasps)
        return tuple(v.tobytes() if isinstance(v, np.ndarray) else v for v in (*values, *poses))

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joints)

    def with_limits(self, lower: Array, upper: Array) -> Arm:
        """The arm within these (dof,), narrowed so that those of tied joints fit each other.

        Raises:
            RobotError: they leave a joint no range.
        """
        # The range of a follower, as a range of the joint that it follows.
        lower, upper = np.array(lower, np.float64), np.array(upper, np.float64)
        for joint, other, factor, offset in self.ties[self.ties[:, 2] != 0.0].tolist():
            low, high = sorted((end[int(joint)] - offset) / factor for end in (lower, upper))
            lower[int(other)] = max(lower[int(other)], low - ROUNDING)
            upper[int(other)] = min(upper[int(other)], high + ROUNDING)
        # Followers have what their masters leave them.
        ends = np.sort(follow_masters(self.ties, np.stack([lower, upper])), axis=0)
        if (ends[0] > ends[1]).any() or (lower > upper)[self.ties[:, 1].astype(int)].any():
            remedy = "limits of joints that mimic each other leave them no range; widen them"
            raise RobotError(f"arm {self.name}: joints", list(self.joints), remedy)
        return replace(self, lower=ends[0], upper=ends[1])

    def nearest_turns(self, Q: Array, q: Array) -> Array:
        """Q (n, dof), turned by whole turns to where its joints are next to q (dof,).

        As far as joints can, and their limits let them.
        """
        Q, turn = np.asarray(Q), 2.0 * np.pi
        if not self.turnable:
            return Q
        # Turns that the limits allow, and of these those nearest to q.
        fewest, most = np.ceil((Q - self.upper) / turn), np.floor((Q - self.lower) / turn)
        turns = np.clip(np.round((Q - q) / turn), fewest, np.maximum(most, fewest))
        return np.where(np.isin(self.joints, self.turnable), Q - turn * turns, Q)


@dataclass(frozen=True, slots=True, eq=False)
class MovingArm:
    """One arm of a robot that moves while all other joints stay where they are.

    Attributes:
        robot, arm: whose.
        q_rest: (nq,) joints of the whole robot; for most questions those of the arm do not matter.
    """

    robot: Robot
    arm: Arm
    q_rest: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "q_rest", frozen_array(self.q_rest, (self.robot.model.nq,)))

    @property
    def q(self) -> Array:
        """(dof,) the arm's part of `q_rest`."""
        return np.asarray(self.q_rest[self.arm.q_index])

    @property
    def q_zero(self) -> Array:
        """(nq,) `q_rest` with the arm's joints at zero: what everything but the arm depends on."""
        q = np.array(self.q_rest)
        q[self.arm.q_index] = 0.0
        return q
