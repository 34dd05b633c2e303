"""With which arms and grasps the search can begin, and why not with the others."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.errors import GraspError, PlacementPlannerError
from placement_planner_ros.core.grasp.hand_opening import opening_error
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.grasp.open_hand import OpenHand
from placement_planner_ros.core.grasp.settings import GraspSettings
from placement_planner_ros.core.grasp.start_state_check import (
    Fault,
    StartRules,
    StartState,
    none_usable,
)
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.robot.arm import Arm, MovingArm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array


def usable_holdings(
    problem: Problem, settings: GraspSettings
) -> tuple[list[list[Holding]], tuple[str, ...]]:
    """Per arm, its grasps for which q_0 is free, and why the others cannot be used.

    Raises:
        StartError: q_0 is free for no arm and grasp.
        GraspError: in every grasp the object overlaps the arm, or the hand could not let it go.
    """
    body, environment = problem.body, problem.environment
    keep_out = environment.keep_out if len(environment.keep_out) else None
    rules = StartRules(settings.collision, environment, settings.tilt, keep_out)
    state = StartState(problem.robot, problem.q_start, body, rules)
    holdings: list[list[Holding]] = []
    faults: list[Fault | GraspError] = []
    for arm in problem.arms:
        step(f"looking where arm {arm.name} begins")
        usable, wrong = state.usable_grasps(arm)
        faults += wrong
        of_arm: list[Holding] = []
        holdings.append(of_arm)
        if not usable:
            continue
        # What every grasp of the arm shares.
        moving = _moving_arm(problem.robot, arm, problem.q_start, settings)
        open_hands: dict[int, OpenHand] = {}
        for grasp in usable:
            step(f"making arm {arm.name} with grasp {grasp}")
            held = AttachedObject(body, grasp)
            pushed = opening_error(moving, held) if settings.require_retreat else None
            if pushed is not None:
                faults.append(pushed)
                continue
            # The grasp with the obstacles that count for it; one open hand for each set of these.
            obstacles, aside = environment.obstacles_of(arm.name, grasp)
            if id(obstacles) not in open_hands:
                open_hands[id(obstacles)] = OpenHand(moving, body, obstacles, settings)
            open_hand = open_hands[id(obstacles)]
            of_arm.append(Holding(moving, held, obstacles, open_hand, settings, aside))
    if not any(holdings):
        raise none_usable(faults)
    return holdings, tuple(map(str, faults))


def lay_out_holdings(
    robot: Robot, arms: Sequence[Arm], q_start: Array, body: Body, settings: GraspSettings
) -> None:
    """Make what `usable_holdings` remembers of robot, object and grasps, without an environment.

    What cannot be used is left out: `usable_holdings` says why.

    Args:
        q_start: (nq,) q_0, which need not be within one turn.
    """
    nothing = ObstacleSet.from_points(np.zeros((1, 3)))
    q_start = robot.unwound(q_start)
    for arm in arms:
        with contextlib.suppress(PlacementPlannerError):
            moving = _moving_arm(robot, arm, q_start, settings)
            open_hand = OpenHand(moving, body, nothing, settings)
            for grasp in range(len(arm.grasps)):
                step(f"laying out arm {arm.name} with grasp {grasp}")
                opening_error(moving, AttachedObject(body, grasp))
                Holding(moving, AttachedObject(body, grasp), nothing, open_hand, settings)


def within_limits(arm: Arm, settings: GraspSettings) -> Arm:
    """The arm with limits drawn in, so that a timed curve between them stays within the real ones.

    What is tabled of an arm before a search is for these; where q_0 is not within them the search
    makes its own.
    """
    inset = np.minimum(settings.limit_inset, 0.25 * (arm.upper - arm.lower))
    return arm.with_limits(arm.lower + inset, arm.upper - inset)


def _moving_arm(robot: Robot, arm: Arm, q_start: Array, settings: GraspSettings) -> MovingArm:
    """That arm at q_0 (nq,), within limits that hold q_0."""
    inside, q = within_limits(arm, settings), q_start[arm.q_index]
    lower, upper = np.minimum(inside.lower, q), np.maximum(inside.upper, q)
    return MovingArm(robot, arm.with_limits(lower, upper), q_start)
