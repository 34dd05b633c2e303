"""From a sample of the hierarchy to a goal: every constraint of the sampling problem, in order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.objective.objective import (
    BoundedObjective,
    EstimatedObjective,
    Objective,
    estimate_batch,
    evaluate_batch,
    evaluate_objective,
    finite_answer,
)
from placement_planner_ros.core.search.sampler import Draws, Outcome, TryOrder, as_drawn
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array, Contact, Goal, Index, Mask, Verdict

_ASKED_AT_ONCE = 64
"""Poses whose objective is asked for together; in between it is looked whether anybody waits."""
_TRIED_CONFIGURATIONS = 2
"""Configurations at most whose approach and retreat are tried at one pose."""


@dataclass(frozen=True, slots=True, eq=False)
class Wanted:
    """A pose x to be reached, what it rests with and on, and ξ(x)."""

    contact: Contact
    x: pin.SE3
    value: float


class GoalFinder:
    """Checks x ∈ V, s(x), c_f(x), rules, ξ(x) > ξ_best, what the tip's pose decides of hand,
    release and approach, then IK, q ∈ C_free, release, approach, retreat.

    Args:
        holdings: per arm, per grasp.
        ik_seeds: starts of the inverse kinematics for each pose, beside q_0.
        rng: chooses the seeds.

    Attributes:
        holdings: all of them, arm after arm.
    """

    def __init__(
        self,
        poses: PoseConstraints,
        holdings: Sequence[Sequence[Holding]],
        objective: Objective,
        ik_seeds: int,
        rng: np.random.Generator,
    ) -> None:
        self._poses = poses
        self.holdings = tuple(holding for of_arm in holdings for holding in of_arm)
        ends = np.cumsum([len(of_arm) for of_arm in holdings])
        self._first = ends - [len(of_arm) for of_arm in holdings]
        self._objective = objective
        # asked once: to tell takes as long as a batch of values
        self._bounded = objective if isinstance(objective, BoundedObjective) else None
        self._ik_seeds = ik_seeds
        self._estimated = isinstance(objective, EstimatedObjective)
        self._rng = rng

    def check_batch(
        self,
        draws: Draws,
        best: float,
        goals: int,
        should_stop: Callable[[], bool],
        order: TryOrder = as_drawn,
    ) -> Outcome:
        """Each up to its first constraint that fails; the cheap ones of all draws together."""
        # Cheap constraints of all draws at once.
        lacking = np.zeros(len(draws.face))
        least = np.full(len(lacking), best) if draws.least is None else draws.least
        verdicts, T = self._poses.verdicts(
            draws.face, draws.contact, draws.angle, draws.slope, lacking
        )
        values = np.where(lacking > 0.0, -lacking, -np.inf)
        free = np.flatnonzero(verdicts == Verdict.FEASIBLE)
        # ξ of those that pass, or about.
        for rows in np.split(free, range(_ASKED_AT_ONCE, len(free), _ASKED_AT_ONCE)):
            if len(rows):
                step("asking the objective")
                values[rows] = self._values(T[rows], float(np.fmin(best, least[rows]).min()))
        verdicts[free] = Verdict.NOT_BETTER
        # What the tip alone decides, with each arm and grasp, of those that may be of use.
        asked = free[~(values[free] <= least[free])]
        firsts = self._first_verdicts(draws, asked, T, values[asked] > best)
        usable = (firsts == Verdict.FEASIBLE).any(axis=1)
        # Those that would be better are to be reached.
        better = asked[values[asked] > best]
        blocked = better[~usable[better]]
        verdicts[blocked] = firsts[blocked].max(axis=1)
        outcome = Outcome(verdicts, values, usable, np.zeros_like(usable), [])
        for row in order(better[usable[better]], outcome, best):
            if should_stop():
                break
            if self._estimated:
                values[row] = evaluate_batch(self._objective, T[[row]])[0]
                if values[row] <= best:
                    continue
            wanted = Wanted(_contact_of(draws, row), pin.SE3(T[row]), float(values[row]))
            outcome.tried[row] = True
            reached = self._reach_any(firsts[row], wanted, best, should_stop)
            if isinstance(reached, Verdict):
                verdicts[row] = reached
                if reached <= Verdict.NOT_BETTER:  # turned as the arm can
                    values[row] = min(values[row], best)
                continue
            verdicts[row] = Verdict.FEASIBLE
            values[row] = reached.objective
            outcome.goals.append(reached)
            if len(outcome.goals) == goals:
                break
        return outcome

    def _values(self, T: Array, best: float) -> Array:
        """(n,) ξ of the poses (n, 4, 4), or about; anything where a bound shows that it is not
        above `best`."""
        bounded = self._bounded
        if bounded is not None:
            return finite_answer(bounded, lambda: bounded.values_above(T, best), len(T))
        return estimate_batch(self._objective, T)

    def _first_verdicts(self, draws: Draws, rows: Index, T: Array, better: Mask) -> Index:
        """(n, h) `Holding.first_verdicts` of these rows of the poses T (n, 4, 4); OUTSIDE_VOLUME of
        others, of arms and grasps other than the one drawn, and once one can of those that are
        not `better`."""
        firsts = np.full((len(T), len(self.holdings)), Verdict.OUTSIDE_VOLUME)
        arm = draws.arm[rows]
        drawn = np.where(arm < 0, -1, self._first[arm] + draws.grasp[rows])
        openings = np.array([self._poses.contacts.opening(f) for f in draws.face[rows].tolist()])
        for k, holding in enumerate(self.holdings if len(rows) else ()):
            asked = (drawn < 0) | (drawn == k)
            asked &= better | (firsts[rows].max(axis=1) < Verdict.FEASIBLE)
            firsts[rows[asked], k] = holding.first_verdicts(T[rows[asked]], openings[asked])
        return firsts

    def _reach_any(
        self, firsts: Index, wanted: Wanted, best: float, should_stop: Callable[[], bool]
    ) -> Goal | Verdict:
        """A goal with the first arm and grasp that can, in random order, of those that may by their
        first verdicts (h,)."""
        may = firsts == Verdict.FEASIBLE
        furthest = Verdict(firsts[~may].max(initial=Verdict.OUTSIDE_VOLUME))
        for k in self._rng.permutation(np.flatnonzero(may)).tolist():
            for goal in self._tries(self.holdings[k], wanted, best):
                if not isinstance(goal, Verdict):
                    return goal
                furthest = max(furthest, goal)
            if should_stop():
                break
        return furthest

    def _tries(self, holding: Holding, wanted: Wanted, best: float) -> Iterator[Goal | Verdict]:
        """What becomes of the pose; where the arm says how the object is turned, of the poses that
        it can give it at that place."""
        # An arm that can turn the object as asked.
        if holding.any_turn is None:
            found = holding.configurations(wanted.x, self._ik_seeds, self._rng)
            yield found if isinstance(found, Verdict) else self._placed(holding, wanted, found)
            return
        # Places for the others, with the turns that the arm can give.
        T_face_object = self._poses.contacts.frames[wanted.contact.feature]
        if T_face_object is None:
            yield Verdict.NO_IK
            return
        places = holding.any_turn.placed(
            wanted.x, T_face_object, self._ik_seeds, self._rng, holding.q_start
        )
        if not places:
            yield Verdict.NO_IK
        # A pose turned otherwise is judged anew.
        for x, Q in places:
            turned, verdict = wanted, Verdict.FEASIBLE
            if x is not wanted.x:
                turned, verdict = self._judged(replace(wanted, x=x), best)
            free = verdict is Verdict.FEASIBLE
            yield self._placed(holding, turned, holding.free_ones(Q)) if free else verdict

    def _judged(self, pose: Wanted, best: float) -> tuple[Wanted, Verdict]:
        """A pose that was not drawn: the same with its ξ, and the first check that it fails."""
        verdict = self._poses.verdict(pose.x, pose.contact)
        if verdict is not Verdict.FEASIBLE:
            return pose, verdict
        pose = replace(pose, value=evaluate_objective(self._objective, pose.x))
        return pose, Verdict.FEASIBLE if pose.value > best else Verdict.NOT_BETTER

    def _placed(self, holding: Holding, wanted: Wanted, Q: Array) -> Goal | Verdict:
        """The goal at one of the configurations Q (k, dof) that reach it, free at contact."""
        # One configuration after the other, up to a few.
        furthest, attempts = Verdict.ARM_COLLIDING, 0
        for q in Q:
            motion = holding.placing_motion(q, wanted.x, wanted.contact, self._poses)
            if not isinstance(motion, Verdict):
                feature, height, slope = wanted.contact
                place = holding.arm.name, holding.grasp, feature, wanted.x, height
                way = motion.approach, wanted.value, motion.retreat, slope, motion.opening
                return Goal(*place, *way)
            furthest = max(furthest, motion)
            # Only those whose approach was tried count.
            attempts += motion > Verdict.NO_RELEASE
            if attempts == _TRIED_CONFIGURATIONS:
                break
        return furthest


def _contact_of(draws: Draws, row: int) -> Contact:
    """The feature of a draw, with z at x = y = 0 of the plane that it stands on and its slope."""
    (x, y, z), (along_x, along_y) = draws.contact[row].tolist(), draws.slope[row].tolist()
    plane = z - (along_x * x + along_y * y), (along_x, along_y)
    return Contact(int(draws.face[row]), *plane)
