"""The part of a robot that a motion of one arm moves, and the rest of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array, frozen_array


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

    def with_open_hand(self) -> MovingArm:
        """The same arm, its hand open."""
        return replace(self, q_rest=self.robot.with_open_hand(self.q_rest, self.arm))
