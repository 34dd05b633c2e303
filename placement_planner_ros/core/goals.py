"""From a sample of the hierarchy to a goal: every constraint of the sampling problem, in order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.ascent import AscentSettings, climb
from placement_planner_ros.core.body import Body
from placement_planner_ros.core.feasibility import PoseConstraints, placement_pose
from placement_planner_ros.core.holding import Holding
from placement_planner_ros.core.objective import Objective, evaluate, moved
from placement_planner_ros.core.search.hierarchy import AfrNode
from placement_planner_ros.core.search.sampler import Sample
from placement_planner_ros.core.types import Array, Goal, Verdict

_FORGETTING = 0.95
"""Share of the best recent climb that is still expected after one that brought less."""
_ATTEMPTS = 2
"""Configurations at most whose approach and retreat are tried at one pose."""


class GoalFinder:
    """Checks s(x), c_f(x), ξ(x) > ξ_best, then IK, q ∈ C_free, release, approach and retreat.

    Args:
        holdings: per arm, per grasp.
        ik_seeds: starts of the inverse kinematics for each pose, beside q_0.
        min_improvement: ξ must exceed ξ_best by this much.
        rng: chooses the seeds.
        ascent: how far to follow the gradient from a stable and free pose before it is judged;
            None to take samples as they are.
    """

    def __init__(
        self,
        body: Body,
        poses: PoseConstraints,
        holdings: Sequence[Sequence[Holding]],
        objective: Objective,
        ik_seeds: int,
        min_improvement: float,
        rng: np.random.Generator,
        ascent: AscentSettings | None = None,
    ) -> None:
        self._body = body
        self._poses = poses
        self._holdings = holdings
        self._objective = objective
        self._ik_seeds = ik_seeds
        self._min_improvement = min_improvement
        self._ascent = ascent
        self._gain = np.inf  # what a climb brought lately, at its best
        self._rng = rng

    def check(self, node: AfrNode, contact: Array, angle: float, best: float) -> Sample:
        """Stops at the first constraint that fails."""
        face, holding = self._choices(node)
        x = placement_pose(self._body.faces[face], contact, angle)
        verdict = self._poses.verdict(x, face, contact[2])
        if verdict is not Verdict.FEASIBLE:
            return Sample(verdict)
        value = evaluate(self._objective, x)
        bound = best + self._min_improvement
        candidates = [(x, value)] if value > bound else []
        if self._ascent is not None and value + self._gain > bound:
            higher = self._climb(x, value, face, contact[2], self._ascent)
            self._gain = max(higher[1] - value, _FORGETTING * self._gain)
            if higher[1] > max(value, bound):
                candidates.insert(0, higher)
        if not candidates:
            return Sample(Verdict.NOT_BETTER)
        furthest = Sample(Verdict.NOT_BETTER)
        for x, value in candidates:
            goal = self._reach_goal(holding, x, face, contact[2], value)
            if not isinstance(goal, Verdict):
                return Sample(Verdict.FEASIBLE, value, goal)
            if goal > furthest.verdict:
                furthest = Sample(goal, value)
        return furthest

    def check_all(self, node: AfrNode, contact: Array, angle: float, best: float) -> Sample:
        """Makes every check, as the authors' four-term reward needs."""
        face, holding = self._choices(node)
        x = placement_pose(self._body.faces[face], contact, angle)
        verdict = self._poses.verdict(x, face, contact[2])
        stable = self._poses.stable(x, face)
        free = self._poses.free(x, contact[2])
        value = evaluate(self._objective, x)
        if not value > best + self._min_improvement:
            value = -np.inf
            verdict = Verdict.NOT_BETTER if verdict is Verdict.FEASIBLE else verdict
        goal = self._reach_goal(holding, x, face, contact[2], value)
        reached = goal is not Verdict.NO_IK
        arm_free = reached and goal is not Verdict.ARM_COLLIDING
        terms = (reached, arm_free, free, stable)
        if verdict is not Verdict.FEASIBLE:
            return Sample(verdict, value, None, terms)
        if isinstance(goal, Verdict):
            return Sample(goal, value, None, terms)
        return Sample(Verdict.FEASIBLE, value, goal, terms)

    def _climb(
        self, x: pin.SE3, value: float, face: int, contact_height: float, settings: AscentSettings
    ) -> tuple[pin.SE3, float]:
        """The highest pose that the gradient leads to within s(x) and c_f(x), and its ξ."""

        def attempt(change: Array) -> pin.SE3 | None:
            nonlocal x, value
            trial = moved(x, change)
            higher = evaluate(self._objective, trial)
            if not higher > value + self._min_improvement:
                return None
            if self._poses.verdict(trial, face, contact_height) is not Verdict.FEASIBLE:
                return None
            x, value = trial, higher
            return x

        climb(self._objective, x, attempt, settings, lambda: False)
        return x, value

    def _choices(self, node: AfrNode) -> tuple[int, Holding]:
        assert node.arm is not None
        assert node.grasp is not None
        assert node.face is not None
        return node.face, self._holdings[node.arm][node.grasp]

    def _reach_goal(
        self, holding: Holding, x: pin.SE3, face: int, contact_height: float, value: float
    ) -> Goal | Verdict:
        found = holding.configurations(x, self._ik_seeds, self._rng)
        if len(found) == 0:
            return Verdict.NO_IK
        furthest, attempts = Verdict.ARM_COLLIDING, 0
        for q in found:
            motion = holding.placing_motion(q, x, contact_height, self._poses)
            if not isinstance(motion, Verdict):
                return Goal(
                    holding.arm.name,
                    holding.grasp,
                    face,
                    x,
                    float(contact_height),
                    motion.approach,
                    value,
                    motion.retreat,
                )
            furthest = max(furthest, motion)
            attempts += motion > Verdict.NO_RELEASE
            if attempts == _ATTEMPTS:
                break
        return furthest
