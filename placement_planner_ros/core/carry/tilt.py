"""Configurations in which a held object leans no more than it may."""

from __future__ import annotations

import math

import numpy as np

from placement_planner_ros.core.carry.settings import TiltLimit
from placement_planner_ros.core.carry.tilt_kernels import TiltedChain, edge_keeps_tilt, project_tilt
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.arm import follow_masters
from placement_planner_ros.core.types import Array, kernel_input

_RESERVE_SHARE = 0.1
"""Of the limit, what planning keeps for rounded corners and timing."""
_COSINE_ROUNDING = 1e-12
"""Of cosines, far above what floating point loses."""


class TiltConstraint:
    """A limit on the tilt of an object that an arm holds, for the arm's configurations and edges.

    Args:
        chain: the arm.
        R_tip_object: (3, 3) how it holds the object.

    Attributes:
        limit: as given.
        planned: rad, what planning keeps to.
    """

    def __init__(self, chain: Chain, R_tip_object: Array, limit: TiltLimit) -> None:
        self.limit = limit
        self.planned = (1.0 - _RESERVE_SHARE) * limit.most
        self._chain = chain
        self._up = kernel_input(R_tip_object @ limit.up)
        frames, work = np.zeros((chain.dof + 1, 4, 4)), np.zeros((5, chain.dof))
        joints = chain.fixed, chain.prismatic, chain.lower, chain.upper
        self._tilted = TiltedChain(*joints, self._up, frames, work)
        self._straight = np.zeros(chain.dof)

    def tilt(self, q: Array) -> float:
        """Angle between the object's `up` and the vertical at q (dof,), rad."""
        x, y, z = self._chain.forward(q)[:3, :3] @ self._up
        return math.atan2(math.hypot(x, y), z)

    def project(self, q: Array) -> Array | None:
        """The configuration (dof,) near q, by Newton steps of least norm, that planning may use.

        None where there is none that way.
        """
        near = np.array(q, dtype=np.float64)
        chain = self._chain
        projected = project_tilt(self._tilted, near, self.planned)
        if projected and len(chain.ties):
            near = follow_masters(chain.ties, near)
            projected = self.tilt(near) <= self.planned
        return near if projected else None

    def keeps(self, a: Array, b: Array) -> bool:
        """Whether all of the straight joint motion from a to b (dof,) leans no more than planned.

        Where an end leans more, which only the start and goals do, no more than the limit.
        """
        end = max(self.tilt(a), self.tilt(b))
        most = self.planned if end <= self.planned else self.limit.most
        return self._edge_keeps(a, b, self._straight, most)

    def keeps_timed(self, a: Array, b: Array, deviation: Array) -> bool:
        """Whether every motion within `deviation` (dof,), joint by joint, of the straight one
        leans no more than the limit."""
        return self._edge_keeps(a, b, kernel_input(deviation), self.limit.most)

    def _edge_keeps(self, a: Array, b: Array, deviation: Array, most: float) -> bool:
        ends = kernel_input(a), kernel_input(b)
        least = math.cos(most) + _COSINE_ROUNDING
        return bool(edge_keeps_tilt(self._tilted, *ends, deviation, least))
