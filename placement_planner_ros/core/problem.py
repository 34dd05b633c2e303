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
        held = max((float(np.linalg.norm(g.translation)) for g in arm.grasps), default=0.0)
        beyond_tip = _HELD_STEP_M * math.ceil((held + size) / _HELD_STEP_M)
        # what slides before anything turns goes its own way; from there on any way is possible
        first = int(np.flatnonzero([*~chain.prismatic, True])[0])
        lengths = np.linalg.norm(chain.fixed[first + 1 :, :3, 3], axis=1).sum()
        slides = np.abs([chain.lower, chain.upper]).max(axis=0)[first:][chain.prismatic[first:]]
        radius = lengths + slides.sum() + beyond_tip + _HAND_LENGTH_M
        at, ends, spheres = np.eye(4), np.zeros((2, 3)), []
        for joint in range(first):
            at = at @ chain.fixed[joint]
            ends += np.sort(np.outer([chain.lower[joint], chain.upper[joint]], at[:3, 2]), axis=0)
        spheres.append(((at @ chain.fixed[first])[:3, 3], radius))
        # the shapes that it carries, as large as they are
        if first > 0:
            q = np.array(q_robot)
            q[arm.q_index] = 0.0
            carried = set(robot.model.subtrees[robot.model.getJointId(arm.joints[0])])
            for thing, T in zip(
                robot.geometry.geometryObjects, robot.geometry_poses(q), strict=True
            ):
                if thing.parentJoint in carried:
                    box = thing.geometry.aabb_local
                    spheres.append((T.act(box.center()), 0.5 * np.linalg.norm(box.max_ - box.min_)))
        for middle, beyond in spheres:
            lower = np.minimum(lower, middle + ends[0] - beyond)
            upper = np.maximum(upper, middle + ends[1] + beyond)
    return lower, upper
