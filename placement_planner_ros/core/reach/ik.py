"""Inverse kinematics of one arm by damped least squares, many seeds at once.

A redundant arm reaches a pose in many ways; which one comes out depends on the seed, so spread
seeds give a spread over the null space. `sweep` lists the ways between and beyond them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.reach import ik_kernels, self_motion
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.reach.reach_bound import ReachBound
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.types import Array, Mask, kernel_input


@dataclass(frozen=True, slots=True)
class IKSettings(Settings):
    """When a pose counts as reached, and how much to try.

    Attributes:
        max_iterations: per seed.
        max_solutions: seeds left over once so many distinct solutions are found are not tried.
        min_difference: solutions closer than this in every joint are the same one.
        sweep_step: the largest change of a joint between neighbours of `sweep`.
        max_sweep: configurations of `sweep` at most.
        max_joint_step: a larger change between waypoints of `track_targets` is a jump.
        line_tolerance: m (and rad); how far the tip may be from the middle between two waypoints
            of `track_targets` when the joints are.
    """

    position_tolerance: float = setting(1e-5, "(0, inf)", "m")
    rotation_tolerance: float = setting(1e-4, "(0, inf)", "rad")
    max_iterations: int = setting(60, "[1, inf)")
    max_solutions: int = setting(32, "[1, inf)")
    min_difference: float = setting(0.1, "(0, inf)", "rad or m")
    sweep_step: float = setting(0.1, "(0, inf)", "rad or m")
    max_sweep: int = setting(384, "[1, inf)")
    max_joint_step: float = setting(0.2, "(0, inf)", "rad or m")
    line_tolerance: float = setting(5e-4, "(0, inf)", "m")


class InverseKinematics:
    """Solves T_world_tip(q) = T for one arm.

    Every configuration returned has been checked to lie within the joint limits and the
    tolerances of the settings.

    Args:
        chain: the arm.
        settings: tolerances and effort.
        reach: how far the arm reaches at most; found where it is not given.
    """

    def __init__(
        self, chain: Chain, settings: IKSettings | None = None, reach: ReachBound | None = None
    ) -> None:
        self.chain = chain
        self.settings = settings or IKSettings()
        of_arm = "fixed", "prismatic", "lower", "upper", "ties"
        values = (
            getattr(chain if name in of_arm else self.settings, name)
            for name in ik_kernels.IKArm._fields
        )
        self._arm = ik_kernels.IKArm(*values)
        self._reach = reach or ReachBound.of(chain)
        self._slack = self.settings.position_tolerance
        self._slack += self.settings.rotation_tolerance * float(np.linalg.norm(self._reach.wrist))

    def reachable(self, T_world_tip: Array) -> Mask:
        """False where poses (..., 4, 4) are further away than the arm is long: no q reaches."""
        return self._reach.within(T_world_tip, self._slack)

    def solve(self, T_world_tip: Array, seeds: Array) -> Array:
        """Distinct solutions (k, dof) for a pose (4, 4) from seeds (s, dof), in seed order.

        k <= settings.max_solutions; k = 0 where no seed led to one. Solutions that differ by full
        turns of a joint count as one.
        """
        dof = self.chain.dof
        solutions = np.empty((self.settings.max_solutions, dof))
        T, scratch = kernel_input(T_world_tip), ik_kernels.ik_scratch(dof)
        count = ik_kernels.solve_target(self._arm, T, kernel_input(seeds), solutions, scratch)
        return solutions[:count]

    def sweep(self, T_world_tip: Array, Q: Array) -> Array:
        """More solutions (k, dof) for a pose (4, 4), on the self-motions of solutions Q (s, dof).

        They lie some sweep_step apart, closer only at limits and in tight bends. k = 0 for arms of
        six joints or fewer, whose solutions are isolated.
        """
        dof = self.chain.dof
        found = np.empty((self.settings.max_sweep, dof))
        T, scratch = kernel_input(T_world_tip), ik_kernels.ik_scratch(dof)
        return found[: self_motion.sweep_target(self._arm, T, kernel_input(Q), found, scratch)]

    def track(self, T_world_tip: Sequence[Array] | Array, q0: Array) -> Array | None:
        """Follow poses (n, 4, 4), each close to the one before, from q0 (dof,) near the first.

        Returns:
            (n, dof), each within limits and tolerances; None where a pose is not reached, a joint
            jumps, or the tip leaves the straight line between two poses by more than
            settings.line_tolerance (then denser poses may succeed).
        """
        chain, T = self.chain, kernel_input(T_world_tip)
        start = np.clip(np.asarray(q0, dtype=np.float64), chain.lower, chain.upper)
        path, scratch = np.empty((len(T), chain.dof)), ik_kernels.ik_scratch(chain.dof)
        tracked = ik_kernels.track_targets(self._arm, T, start, path, scratch)
        return path if tracked else None
