"""Bounds on an arm's reach and on how far its joints move what it holds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import minimize

from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.types import ROUNDING, Array, Mask


@dataclass(frozen=True, slots=True, eq=False)
class ReachBound:
    """No configuration takes `wrist` further than `length` from `shoulder`.

    A point on a joint's axis stays where it is when the joint turns, so the distance from a point
    on the first axis to one on the last is at most the sum of the distances between the points
    chosen on consecutive axes. They are chosen to make that sum small. A sliding joint counts
    from the middle of its range and adds half of it.

    Attributes:
        shoulder: (3,) point on the first axis, in the world.
        wrist: (3,) point on the last axis, in the tip frame.
        length: m.
    """

    shoulder: Array
    wrist: Array
    length: float

    @classmethod
    @lru_cache(maxsize=64)
    def of(cls, chain: Chain) -> ReachBound:
        """The bound of a chain, remembered."""
        # A joint that slides stands in the middle of its range.
        frames = chain.fixed
        middle = np.where(chain.prismatic, 0.5 * (chain.lower + chain.upper), 0.0)
        half = np.where(chain.prismatic, 0.5 * (chain.upper - chain.lower), 0.0)

        def gaps(along: Array) -> Array:
            """(dof - 1, 3) vectors between points at `along` on consecutive axes."""
            links = frames[1:-1]
            ahead = links[:, :3, 3] + links[:, :3, 2] * (along + middle)[1:, None]
            behind = np.zeros_like(ahead)
            behind[:, 2] = along[:-1]
            return ahead - behind

        def total(along: Array) -> float:
            return float(np.linalg.norm(gaps(along), axis=1).sum())

        # Points on the axes with the least way through them.
        along = np.asarray(minimize(total, np.zeros(chain.dof), method="Powell").x).reshape(-1)
        T_last_tip = frames[-1]
        on_last = np.array([0.0, 0.0, along[-1]])
        on_first = np.array([0.0, 0.0, along[0] + middle[0], 1.0])
        # What a slide may add to the way.
        return ReachBound(
            shoulder=(frames[0] @ on_first)[:3],
            wrist=T_last_tip[:3, :3].T @ (on_last - T_last_tip[:3, 3]),
            length=total(along) + float(half.sum()) + ROUNDING,
        )

    def within(self, T_world_tip: Array, slack: float) -> Mask:
        """Which of the (..., 4, 4) poses are no further than `slack` m beyond `length`."""
        gap = T_world_tip[..., :3, :3] @ self.wrist + T_world_tip[..., :3, 3] - self.shoulder
        return np.asarray((gap * gap).sum(axis=-1) <= (self.length + slack) ** 2)


def lever_arms(chain: Chain, points: Array) -> Array:
    """(dof,) most metres that any of the points (n, 3) of the tip moves per unit of each joint."""
    slides = np.where(chain.prismatic, np.maximum(np.abs(chain.lower), np.abs(chain.upper)), 0.0)
    links = np.linalg.norm(chain.fixed[1:, :3, 3], axis=1)
    links[:-1] += slides[1:]
    links[-1] += float(np.linalg.norm(points, axis=1).max())
    return np.asarray(np.where(chain.prismatic, 1.0, np.cumsum(links[::-1])[::-1]))
