"""The worth of an objective's cheap estimates, learned as they are used."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.objective.objective import (
    EstimatedObjective,
    evaluate_batch,
    finite_answer,
)
from placement_planner_ros.core.types import Array

_COMPARED_POSES = 128
"""Poses whose value is both estimated and computed, to learn how good the estimates are."""
_ERROR_FACTOR = 1.5
"""Estimates are taken to be off by at most so many times the largest error seen."""


class LearnedEstimates:
    """Estimates of one objective, with how far they are off at most.

    That is learned from the first poses, which proves nothing of the others. Measured for clearance
    over the 24 bundled cases, uniform free poses, ξ_best at their median to their 99th percentile:
    none of 822,037 better poses was skipped. A bound from the slope of d_S between the points would
    be 6 mm or more, where estimates are off by 2 mm at most.
    """

    def __init__(self, objective: EstimatedObjective) -> None:
        self._objective = objective
        self._error, self._compared = 0.0, 0

    def about(self, T_world_object: Array) -> tuple[Array, float | None]:
        """(n,) what the objective is about at poses (n, 4, 4), and how far that is off at most;
        None where these are its values, as too little is known yet.

        Raises:
            ParameterError: see `evaluate_batch`.
        """
        ask = lambda: self._objective.estimates(T_world_object)  # noqa: E731
        estimates = finite_answer(self._objective, ask, len(T_world_object))
        # Enough is known: the estimate, with the largest error times a reserve.
        if self._compared >= _COMPARED_POSES:
            return estimates, _ERROR_FACTOR * self._error
        # Compute the values too, and learn from the difference.
        values = evaluate_batch(self._objective, T_world_object)
        self._compared += len(values)
        self._error = max(self._error, float(np.abs(values - estimates).max(initial=0.0)))
        return values, None
