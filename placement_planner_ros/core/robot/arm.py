"""An arm that could be holding the object: a chain of joints, a tip, grasps and a hand."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.types import Array, frozen_array


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
    """

    name: str
    tip_frame: str
    joints: tuple[str, ...]
    grasps: tuple[pin.SE3, ...]
    touch_links: tuple[str, ...]
    gripper_joints: tuple[str, ...]
    gripper_open: tuple[float, ...]
    q_index: npt.NDArray[np.int64]
    lower: Array
    upper: Array
    velocity: Array

    def __post_init__(self) -> None:
        index = np.array(self.q_index, dtype=np.int64)
        index.setflags(write=False)
        object.__setattr__(self, "q_index", index)
        for name in ("lower", "upper", "velocity"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (len(index),)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Arm) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    @property
    def _content(self) -> tuple[Hashable, ...]:
        return (
            self.name,
            self.tip_frame,
            self.joints,
            tuple(grasp.homogeneous.tobytes() for grasp in self.grasps),
            self.touch_links,
            self.gripper_joints,
            self.gripper_open,
            self.q_index.tobytes(),
            self.lower.tobytes(),
            self.upper.tobytes(),
            self.velocity.tobytes(),
        )

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joints)
