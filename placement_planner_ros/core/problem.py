"""One placement task, and the space it takes place in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.clearance_table import CAP
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.keep_out import boxes_of
from placement_planner_ros.core.types import Array, TargetVolume

_HAND_LENGTH_M = 0.3
"""m, how far a hand is taken to extend beyond its tip frame in `workspace`."""
_HELD_STEP_M = 0.5
"""m, of which what is held is taken to reach a whole number beyond the tip, so that the workspace,
and the environment, is the same for all objects of about a size."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """One placement task.

    Attributes:
        arms: 𝒜, the arms that could be holding the object, each with its grasps.
        q_start: (nq,) q_0, every joint of the robot.
        body: the object o.
        volume: V.
        environment: the obstacle set, R and their support.
    """

    robot: Robot
    arms: tuple[Arm, ...]
    q_start: Array
    body: Body
    volume: TargetVolume
    environment: Environment

    def __post_init__(self) -> None:
        if not any(arm.grasps for arm in self.arms):
            raise RobotError(
                "arms", [arm.name for arm in self.arms], "give at least one arm with a grasp"
            )


def with_exclusion_zones(problem: Problem, keep_out: Sequence[float]) -> Problem:
    """The problem with boxes, six numbers each, that nothing which moves may enter."""
    if not keep_out:
        return problem
    around = workspace(problem.robot, problem.arms, problem.q_start, problem.body, problem.volume)
    return replace(
        problem, environment=problem.environment.keeping_out(boxes_of(keep_out), *around)
    )


def workspace(
    robot: Robot, arms: tuple[Arm, ...], q_robot: Array, body: Body, volume: TargetVolume
) -> tuple[Array, Array]:
    """Box (lower (3,), upper (3,)) that holds V, what counts for clearance around it, and whatever
    arm, hand and object can touch; the same for objects that reach about as far from the hand."""
    size = float(np.linalg.norm(np.ptp(body.vertices, axis=0)))
    around = max(_HELD_STEP_M * math.ceil(size / _HELD_STEP_M), CAP)
    lower, upper = volume.lower - around, volume.upper + around
    for arm in arms:
        chain = Chain.from_robot(robot, arm, q_robot)
        lengths = np.linalg.norm(chain.fixed[1:, :3, 3], axis=1).sum()
        slides = np.abs([chain.lower, chain.upper]).max(axis=0)[chain.prismatic].sum()
        held = max((float(np.linalg.norm(g.translation)) for g in arm.grasps), default=0.0)
        beyond_tip = _HELD_STEP_M * math.ceil((held + size) / _HELD_STEP_M)
        radius = lengths + slides + beyond_tip + _HAND_LENGTH_M
        base = chain.fixed[0, :3, 3]
        lower, upper = np.minimum(lower, base - radius), np.maximum(upper, base + radius)
    return lower, upper
