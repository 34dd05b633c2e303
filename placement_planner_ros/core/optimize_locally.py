"""OptimizeLocally: follow ∂ξ/∂(x, y, e_z) from a goal without ever leaving the constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.objective.ascent import AscentSettings, climb_objective
from placement_planner_ros.core.objective.objective import Objective, evaluate_objective
from placement_planner_ros.core.types import Array, Goal, Verdict, upright


class LocalOptimizer:
    """Gradient ascent with a growing and shrinking step, along whatever directions stay open.

    The object moves while raised; approach and retreat are derived anew at each pose that is kept.
    """

    def __init__(
        self,
        poses: PoseConstraints,
        objective: Objective,
        min_improvement: float,
        settings: AscentSettings,
    ) -> None:
        self._poses = poses
        self._objective = objective
        self._min_improvement = min_improvement
        self._settings = settings

    def optimize(
        self, goal: Goal, holding: Holding, should_stop: Callable[[], bool]
    ) -> tuple[Goal, Array]:
        """Improve a goal locally: Δq ← J†(q) v(∂ξ/∂(x, y, e_z)), q ← q + μΔq.

        The step is then corrected by IK to the pose x + μ ∂ξ exactly, so the object neither tilts
        nor leaves its contact plane. A trial is kept if ξ rises and every constraint holds.

        Returns:
            the improved goal, or the given one; and (k, dof) raised configurations from the given
            goal's to this one's, edges certified.
        """
        slide = [goal.q_raised]

        def attempt(change: Array) -> pin.SE3 | None:
            nonlocal goal
            better = self._try(goal, holding, change)
            if better is None:
                return None
            goal = better
            slide.append(goal.q_raised)
            return goal.T_world_object

        climb_objective(
            self._objective, goal.T_world_object, attempt, self._settings, should_stop, goal.slope
        )
        return goal, np.array(slide)

    def _try(self, goal: Goal, holding: Holding, change: Array) -> Goal | None:
        # The pose that the change leads to, as far as the arm can give it.
        x, q = self._poses.contacts.moved(goal.T_world_object, goal.contact, change), None
        if x is None:
            return None
        if holding.any_turn is not None:
            # The turn is what an arm of few joints gives at that place.
            T_face_object = self._poses.contacts.frames[goal.face]
            if T_face_object is None:
                return None
            given = holding.any_turn.follow(x, T_face_object, goal.q)
            if given is None:
                return None
            x, q = given
        # It must be better, and keep what is asked of poses.
        value = evaluate_objective(self._objective, x)
        if not value > goal.objective + self._min_improvement:
            return None
        verdict = self._poses.verdict(x, goal.contact)
        if verdict is not Verdict.FEASIBLE:
            return None
        # The arm must reach it, and be free there and on the way.
        q = self._step(goal, holding, x, change) if q is None else q
        if q is None:
            return None
        motion = holding.placing_motion(q, x, goal.contact, self._poses)
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
        # The change as a twist, along the plane and about its normal.
        rise = goal.slope[0] * change[0] + goal.slope[1] * change[1]
        normal = upright(goal.slope)[:, 2]
        v = np.array([change[0], change[1], rise, *(change[2] * normal)])
        # A step by the Jacobian, within the limits of the joints.
        predicted = goal.q + np.linalg.pinv(J, rcond=1e-3) @ v
        predicted = np.clip(predicted, holding.arm.lower, holding.arm.upper)
        return holding.follow(x, predicted)
