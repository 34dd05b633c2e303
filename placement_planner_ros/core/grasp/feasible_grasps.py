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
    beyond_limits,
    met_environment,
    none_usable,
)
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array

_LIMIT_INSET_RAD_OR_M = 1e-3
"""rad or m, how far within the joint limits configurations are planned."""


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
    holdings: list[list[Holding]] = []
    faults: list[Fault] = []
    bad_grasps: list[GraspError] = []
    for arm in problem.arms:
        holdings.append([])
        # q_0 must lie within the arm's limits.
        beyond = beyond_limits(arm, problem.q_start)
        if beyond is not None:
            faults.append(beyond.of(arm.name))
            continue
        # What every grasp of the arm shares.
        step(f"making the open hand of arm {arm.name}")
        arm = _within_limits(arm, problem.q_start[arm.q_index])
        moving = MovingArm(problem.robot, arm, problem.q_start)
        open_hands: dict[int, OpenHand] = {}
        for grasp in range(len(arm.grasps)):
            step(f"making arm {arm.name} with grasp {grasp}")
            # The grasp with the obstacles that count for it; one open hand for each set of these.
            obstacles, aside = environment.obstacles_of(arm.name, grasp)
            if id(obstacles) not in open_hands:
                open_hands[id(obstacles)] = OpenHand(moving, body, obstacles, settings)
            open_hand, held = open_hands[id(obstacles)], AttachedObject(body, grasp)
            rules = StartRules(settings.collision, obstacles, settings.tilt, keep_out)
            placed = StartState(moving.robot, moving.q_rest, body, rules)
            bad = _grasp_error(placed, moving, held, settings.require_retreat)
            if bad is not None:
                bad_grasps.append(bad)
                continue
            # Whether q_0 is free with the object held so.
            holding = Holding(moving, held, obstacles, open_hand, settings, aside)
            fault = placed.leans(arm, grasp) or placed.in_zones(arm, grasp)
            if fault is None and not holding.collision.free(holding.q_start):
                # What is not certain to be free may be so close to the margin that coal calls it
                # free.
                met = holding.collision.explain(holding.q_start)
                fault = placed.of_arm(arm) or placed.of_grasp(arm, grasp)
                fault = fault or met_environment(met, True, settings.collision.collision_margin)
            if fault is None:
                holdings[-1].append(holding)
            else:
                faults.append(fault.of(f"{arm.name} with grasp {grasp}"))
    if not any(holdings):
        raise none_usable(faults, bad_grasps)
    return holdings, (*map(str, bad_grasps), *map(str, faults))


def _grasp_error(
    placed: StartState, moving: MovingArm, held: AttachedObject, release: bool
) -> GraspError | None:
    """All that is wrong with a grasp, at once: the object lies in the hand, or could not be let go
    wherever it stood."""
    errors = [placed.object_in_hand(moving.arm, held.grasp)]
    if release:
        errors.append(opening_error(moving, held))
    found = [error for error in errors if error is not None]
    if not found:
        return None
    return GraspError(found[0].field, found[0].value, ". ".join(e.remedy for e in found))


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
            moving = MovingArm(robot, _within_limits(arm, q_start[arm.q_index]), q_start)
            open_hand = OpenHand(moving, body, nothing, settings)
            for grasp in range(len(arm.grasps)):
                step(f"laying out arm {arm.name} with grasp {grasp}")
                opening_error(moving, AttachedObject(body, grasp))
                Holding(moving, AttachedObject(body, grasp), nothing, open_hand, settings)


def _within_limits(arm: Arm, q_start: Array) -> Arm:
    """The arm with limits drawn in, so that a timed curve between them stays within the real ones.

    A curve may stray from its chords by up to the timing's `chord_tolerance`.
    """
    inset = np.minimum(_LIMIT_INSET_RAD_OR_M, 0.25 * (arm.upper - arm.lower))
    return arm.with_limits(
        np.minimum(arm.lower + inset, q_start), np.maximum(arm.upper - inset, q_start)
    )
