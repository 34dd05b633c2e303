"""A weighted sum of terms, and terms that are required."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.objective.aligned import Aligned
from placement_planner_ros.core.objective.beside import Edge
from placement_planner_ros.core.objective.objective import (
    EstimatedObjective,
    Objective,
    ObjectiveContext,
    PoseRanges,
    estimate_batch,
    evaluate_batch,
    objective_gradient,
)
from placement_planner_ros.core.objective.supporting_faces import SupportingFaces
from placement_planner_ros.core.objective.terms import (
    ClearanceTerm,
    High,
    Near,
    SlowTerm,
    Stance,
    Term,
    Turn,
    term_ends,
)
from placement_planner_ros.core.types import SINGLE_ROUNDING, Array, Mask

BUILT_IN: dict[str, Callable[[ObjectiveContext], Term]] = {
    "clearance": ClearanceTerm,
    "near": Near,
    "turn": Turn,
    "high": High,
    "edge": Edge,
    "aligned": Aligned,
    "stance": Stance,
}
"""Terms by name."""


class PlugInTerm:
    """A user's objective as a term; it has no unit, and what it could be is not known."""

    scale = 1.0
    ends = (-math.inf, math.inf)
    expensive = True

    def __init__(self, objective: Objective) -> None:
        self._objective = objective

    def values(self, T_world_object: Array) -> Array:
        """(n,) at poses (n, 4, 4)."""
        return evaluate_batch(self._objective, T_world_object)

    def gradient(self, T_world_object: pin.SE3) -> Array:
        """(3,) its own, or by differences."""
        return objective_gradient(self._objective, T_world_object)


class _WeightedPart:
    """One term of a sum.

    Attributes:
        factor: what its values are multiplied by.
    """

    def __init__(self, term: Term, factor: float) -> None:
        self.term, self.factor = term, factor

    @property
    def most(self) -> float:
        """What it adds at most, wherever."""
        return float((self.factor * np.array(self.term.ends)).max()) if self.factor else 0.0

    @property
    def bounded(self) -> bool:
        """Whether it is known what it adds at most."""
        return isinstance(self.term, SlowTerm) or self.most < np.inf

    def most_around(self, ranges: PoseRanges, rough: bool) -> Array:
        """(n,) what it adds at most at any pose of each range."""
        if not self.factor:
            return np.zeros(len(ranges.T))
        ends = term_ends(self.term, ranges, rough)
        return np.asarray(self.factor * ends[int(self.factor > 0.0)])


class Weighted:
    """ξ = Σ weight · term / scale, over `WishSettings.terms`.

    Dear terms are computed only for poses that could be better by all that is known of the others.

    Args:
        make: makes the term of a name.

    Attributes:
        bounded: whether it is known of all terms what they are at most.

    Raises:
        ParameterError: no term is named, or they do not fit together.
    """

    def __init__(
        self, context: ObjectiveContext, make: Callable[[str, ObjectiveContext], Term]
    ) -> None:
        wishes = context.wishes
        if not wishes.terms:
            raise ParameterError("`terms`", [], "name at least one for objective: weighted")
        wishes.require_consistent()
        weights = wishes.weights or (1.0,) * len(wishes.terms)
        self._terms = {name: make(name, context) for name in wishes.terms}
        parts = [
            _WeightedPart(term, weight / term.scale)
            for term, weight in zip(self._terms.values(), weights, strict=True)
        ]
        # Cheap terms are computed before the others.
        self._cheap = [part for part in parts if not part.term.expensive]
        self._expensive = [part for part in parts if part.term.expensive]
        self._standing = SupportingFaces(context)
        self.bounded = all(part.bounded for part in parts)

    def __call__(self, T_world_object: pin.SE3) -> float:
        """ξ(x)."""
        return float(self.values(T_world_object.homogeneous[None])[0])

    def terms(self, T_world_object: pin.SE3) -> dict[str, float]:
        """The value of each by its name, in its own unit."""
        T = T_world_object.homogeneous[None]
        return {name: float(term.values(T)[0]) for name, term in self._terms.items()}

    def values(self, T_world_object: Array) -> Array:
        """(n,) ξ of the (n, 4, 4) poses."""
        total = np.zeros(len(T_world_object))
        for part in (*self._cheap, *self._expensive):
            total += part.factor * part.term.values(T_world_object)
        return total

    def values_above(self, T_world_object: Array, best: float) -> Array:
        """(n,) ξ of the (n, 4, 4) poses; at most `best` where that, or about, is not above it."""
        T = T_world_object
        # What the cheap terms add up to.
        total = np.zeros(len(T))
        for part in self._cheap:
            total += part.factor * part.term.values(T)
        if not self._expensive:
            return total
        # At most what the expensive ones add.
        most = np.array([np.full(len(T), part.most) for part in self._expensive])
        # Estimates first, where a pose could still be better than the best.
        for part, row in zip(self._expensive, most, strict=True):
            left = np.flatnonzero(total + most.sum(axis=0) > best)
            if len(left) and isinstance(part.term, EstimatedObjective):
                estimates = estimate_batch(part.term, T[left])
                row[left] = np.minimum(row[left], part.factor * estimates)
        # Then the terms themselves, one after the other, where it still could.
        for k, part in enumerate(self._expensive):
            left = np.flatnonzero(total + most.sum(axis=0) > best)
            if len(left):
                most[k, left] = part.factor * part.term.values(T[left])
        return np.asarray(total + most.sum(axis=0))

    def most_around(self, ranges: PoseRanges, rough: bool = False) -> Array:
        """(n,) what ξ does not exceed at any pose of each range."""
        parts = (*self._cheap, *self._expensive)
        return np.asarray(sum(part.most_around(ranges, rough) for part in parts))

    def gradient(self, T_world_object: pin.SE3) -> Array:
        """∂ξ/∂(x, y, e_z), within the plane that the object stands on."""
        # The slope of the plane that the object stands on.
        stood = self._standing.at(T_world_object.homogeneous[None])
        slope = self._standing.slopes[stood.slope[0]]
        return np.asarray(
            sum(
                part.factor * objective_gradient(part.term, T_world_object, slope)
                for part in (*self._cheap, *self._expensive)
            )
        )


class Requirements:
    """Terms that are never below a value.

    Args:
        make: makes the term of a name.

    Attributes:
        terms_asked: each by its name, and what it must reach.
    """

    def __init__(
        self, context: ObjectiveContext, make: Callable[[str, ObjectiveContext], Term]
    ) -> None:
        wishes = context.wishes  # which the planner has found consistent
        self.terms_asked = tuple(
            (name, make(name, context), least)
            for name, least in zip(wishes.required, wishes.at_least, strict=True)
        )

    def lacking(self, T_world_object: Array) -> Array:
        """(n,) by how many of their scales all together are too low at poses (n, 4, 4); 0 where all
        are reached. Expensive ones are asked only where the others are."""
        total = np.zeros(len(T_world_object))
        for expensive in (False, True):
            # Terms are asked of poses that lack nothing so far.
            rows = np.flatnonzero(total == 0.0)
            terms = [
                (term, least) for _, term, least in self.terms_asked if term.expensive == expensive
            ]
            # By how many scales each is too low.
            for term, least in terms if len(rows) else ():
                short = least - term.values(T_world_object[rows])
                total[rows] += np.where(short > SINGLE_ROUNDING, short, 0.0) / term.scale
        return total

    def impossible(self, ranges: PoseRanges) -> Mask:
        """(n,) ranges at all of whose poses one of them is too low."""
        # Arithmetic may be off by as much again.
        allowed = 2.0 * SINGLE_ROUNDING
        low = [term_ends(term, ranges)[1] < least - allowed for _, term, least in self.terms_asked]
        return np.asarray(np.any(low, axis=0))

    def terms(self, T_world_object: pin.SE3) -> dict[str, float]:
        """The value of each by its name, in its own unit."""
        T = T_world_object.homogeneous[None]
        return {name: float(term.values(T)[0]) for name, term, _ in self.terms_asked}
