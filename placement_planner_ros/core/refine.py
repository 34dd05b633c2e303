"""OptimizeLocally: follow ∂ξ/∂(x, y, e_z) from a goal without ever leaving the constraints."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.feasibility import PoseConstraints
from placement_planner_ros.core.holding import Holding
from placement_planner_ros.core.objective import Objective, evaluate, gradient, moved
from placement_planner_ros.core.types import Array, Goal, Verdict


@dataclass(frozen=True, slots=True)
class RefineSettings:
    """Step control of the local optimisation.

    Attributes:
        first_step: length of the first step, metres.
        last_step: the search ends once steps are shorter than this, metres.
        turn_radius: metres that one radian of e_z counts as.
        max_steps: trial steps at most.
    """

    first_step: float = 0.02
    last_step: float = 2e-4
    turn_radius: float = 0.1
    max_steps: int = 100

    def __post_init__(self) -> None:
        if not 0.0 < self.last_step <= self.first_step:
            raise ParameterError("last_step", self.last_step, "must be in (0, first_step]")
        if not self.turn_radius > 0.0:
            raise ParameterError("turn_radius", self.turn_radius, "must be above zero")
        if self.max_steps < 0:
            raise ParameterError("max_steps", self.max_steps, "must be zero or larger")


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """A locally optimised goal.

    Attributes:
        goal: the improved goal (or the given one).
        slide: (k, dof) raised configurations from the given goal's to this one's, edges certified.
    """

    goal: Goal
    slide: Array


class LocalOptimizer:
    """Gradient ascent with a growing and shrinking step, along whatever directions stay open.

    The object moves while raised; approach and retreat are derived anew at each pose that is kept.
    """

    def __init__(
        self,
        poses: PoseConstraints,
        objective: Objective,
        min_improvement: float,
        settings: RefineSettings,
    ) -> None:
        self._poses = poses
        self._objective = objective
        self._min_improvement = min_improvement
        self._settings = settings

    def optimize(self, goal: Goal, holding: Holding, should_stop: Callable[[], bool]) -> Refined:
        """Improve a goal locally: Δq ← J†(q) v(∂ξ/∂(x, y, e_z)), q ← q + μΔq.

        The step is then corrected by IK to the pose x + μ ∂ξ exactly, so the object neither tilts
        nor leaves its height. A trial is kept if ξ rises and every constraint holds.
        """
        settings = self._settings
        slide = [goal.q_raised]
        step = settings.first_step
        directions: Iterator[Array] = self._directions(goal.T_world_object)
        for _ in range(settings.max_steps):
            if should_stop():
                break
            direction = next(directions, None)
            if direction is None:
                step /= 2.0
                if step < settings.last_step:
                    break
                directions = self._directions(goal.T_world_object)
                continue
            better = self._try(goal, holding, step * direction)
            if better is None:
                continue
            goal = better
            slide.append(goal.q_raised)
            step = min(2.0 * step, settings.first_step)
            directions = self._directions(goal.T_world_object)
        return Refined(goal, np.array(slide))

    def _directions(self, x: pin.SE3) -> Iterator[Array]:
        """Ascent directions in (x, y, e_z), of unit length: the gradient, then its components.

        At a wall the gradient itself is blocked while one of its components still is free.
        """
        scale = np.array([1.0, 1.0, 1.0 / self._settings.turn_radius])
        ascent = gradient(self._objective, x) * scale
        for mask in ((1, 1, 1), (1, 1, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)):
            masked = ascent * mask
            length = float(np.linalg.norm(masked))
            if length > 1e-9:
                yield masked / length * scale

    def _try(self, goal: Goal, holding: Holding, change: Array) -> Goal | None:
        x = moved(goal.T_world_object, change)
        value = evaluate(self._objective, x)
        if not value > goal.objective + self._min_improvement:
            return None
        if self._poses.verdict(x, goal.face, goal.contact_height) is not Verdict.FEASIBLE:
            return None
        q = self._step(goal, holding, x, change)
        if q is None:
            return None
        motion = holding.placing_motion(q, x, goal.contact_height, self._poses)
        if isinstance(motion, Verdict):
            return None
        if not holding.transit_free(goal.q_raised, motion.approach[0]):
            return None
        return replace(
            goal,
            T_world_object=x,
            approach=motion.approach,
            retreat=motion.retreat,
            objective=value,
        )

    def _step(self, goal: Goal, holding: Holding, x: pin.SE3, change: Array) -> Array | None:
        """q + μΔq with Δq = J† v, brought exactly to pose x."""
        J = holding.chain.jacobian(goal.q, holding.arm.grasps[goal.grasp].homogeneous)
        v = np.array([change[0], change[1], 0.0, 0.0, 0.0, change[2]])
        predicted = goal.q + np.linalg.pinv(J, rcond=1e-3) @ v
        predicted = np.clip(predicted, holding.arm.lower, holding.arm.upper)
        return holding.follow(x, predicted)
