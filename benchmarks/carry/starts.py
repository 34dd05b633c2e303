"""Starts that hold the object nearly upright, and which way that is in each grasp.

In the cases' own starts the object hangs as the hand does. So `object.up` is, for each grasp, the
way up on the rest on which the planner without any limit first puts the object with it, and the
arm is brought from the case's start to where that points up.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from placement_planner_ros.core.carry.settings import TiltLimit
from placement_planner_ros.core.carry.tilt import TiltConstraint
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.grasp.feasible_grasps import usable_holdings
from placement_planner_ros.core.objective.objective import Objective
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.types import Array, Placement

START_TILT = math.radians(5.0)
"""The object leans by less than that at the start."""
_SAMPLES = 4000
"""Of the search for a rest in each grasp."""
_TRIES = 400
"""Starts that are tried for each grasp."""
_STEP = 0.01
"""rad, by which tries differ more and more from the case's start."""
_FURTHER = 0.7
"""Share of the last joint's range, from its middle, that it is turned by for an opposite start."""


def upright_task(
    problem: Problem, objective: Objective, seed: int, opposite: bool
) -> tuple[Problem, Array] | None:
    """A case's problem with one arm in one grasp that holds the object nearly upright, and
    `object.up` (3,); None where no grasp of the seed's arm makes one.

    Arms take turns from seed to seed, and so does the grasp that is tried first.

    Args:
        opposite: start with the last joint turned to the other side of its range than where the
            placement of the search for a rest needs it.
    """
    arm = problem.arms[seed % len(problem.arms)]
    for k in range(len(arm.grasps)):
        grasp = (seed + k) % len(arm.grasps)
        task = replace(problem, arms=(replace(arm, grasps=(arm.grasps[grasp],)),))
        rng = np.random.default_rng([seed, grasp])
        first = _first_placement(task, objective, rng)
        if first is None:
            continue
        up = np.array(task.body.faces[first.goal.face].T_face_object.rotation[2])
        q_end = first.goal.q if opposite else None
        q_start = _upright_start(task, up, q_end, rng)
        if q_start is not None:
            return replace(task, q_start=q_start), up
    return None


def _first_placement(
    problem: Problem, objective: Objective, rng: np.random.Generator
) -> Placement | None:
    try:
        planner = PlacementPlanner(problem, objective, PlannerSettings(), rng)
    except PlacementPlannerError:
        return None  # this grasp cannot be held at the case's start
    return next(planner.run(lambda: planner.statistics.samples >= _SAMPLES), None)


def _upright_start(
    problem: Problem, up: Array, q_end: Array | None, rng: np.random.Generator
) -> Array | None:
    """q_0 (nq,), free and with the object nearly upright, next to the case's.

    Args:
        q_end: where the arm is at the placement, from which the start is to be turned away.
    """
    arm = problem.arms[0]
    chain = Chain.from_robot(problem.robot, arm, problem.q_start)
    constraint = TiltConstraint(chain, arm.grasps[0].rotation, TiltLimit(up, START_TILT))
    own = problem.q_start[arm.q_index]
    middle, half = 0.5 * (arm.lower + arm.upper)[-1], 0.5 * (arm.upper - arm.lower)[-1]
    for k in range(_TRIES):
        q = own + rng.normal(0.0, _STEP * k, arm.dof)
        if q_end is not None:
            side = -np.sign(q_end[-1] - middle) or 1.0
            q[-1] = middle + side * half * rng.uniform(_FURTHER, 0.95)
        near = constraint.project(np.clip(q, arm.lower, arm.upper))
        if near is None or (q_end is not None and abs(near[-1] - q_end[-1]) < _FURTHER * half):
            continue
        q_start = np.array(problem.q_start)
        q_start[arm.q_index] = near
        try:
            usable_holdings(replace(problem, q_start=q_start), PlannerSettings().grasp)
        except PlacementPlannerError:
            continue
        return q_start
    return None
