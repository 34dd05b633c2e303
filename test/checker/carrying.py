"""How the object is carried: its largest tilt and acceleration on the way, computed anew."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from .curve import quintic
from .robot import RobotModel
from .task import Array, Solution, Task, Tolerances

_PER_PIECE = 33
"""Moments looked at between two points of the trajectory."""


@dataclass(frozen=True)
class Way:
    """What the object went through on its way.

    Attributes:
        tilt: the largest angle of the task's `up` from the vertical, rad; 0 without.
        acceleration: the largest of the centre of mass, m/s².
    """

    tilt: float
    acceleration: float


def way_of_object(robot: RobotModel, task: Task, solution: Solution, q_rest: Array) -> Way:
    """Of all of the trajectory, by pinocchio's velocities and accelerations of the tip.

    Args:
        q_rest: (nq,) where joints stand that are not the trajectory's.
    """
    curve, model = solution.trajectory, robot.model
    columns = [robot.index[name] for name in curve.joints]
    frame, data = model.getFrameId(solution.tip_frame), model.createData()
    T_tip_object = np.asarray(solution.T_tip_object)
    center = T_tip_object[:3, :3] @ np.asarray(task.center_of_mass) + T_tip_object[:3, 3]
    lowest, hardest = 1.0, 0.0
    for i, duration in enumerate(np.diff(curve.times)):
        for state in zip(*quintic(curve, i, np.linspace(0.0, duration, _PER_PIECE)), strict=True):
            q, v, a = q_rest.copy(), np.zeros(model.nv), np.zeros(model.nv)
            q[columns], v[columns], a[columns] = state
            pin.forwardKinematics(model, data, q, v, a)
            R = pin.updateFramePlacement(model, data, frame).rotation
            world = pin.LOCAL_WORLD_ALIGNED
            turning = pin.getFrameVelocity(model, data, frame, world).angular
            classical = pin.getFrameClassicalAcceleration(model, data, frame, world)
            arm = R @ center
            reached = classical.linear + np.cross(classical.angular, arm)
            reached = reached + np.cross(turning, np.cross(turning, arm))
            hardest = max(hardest, float(np.linalg.norm(reached)))
            if task.up is not None:
                up = R @ T_tip_object[:3, :3] @ np.asarray(task.up)
                lowest = min(lowest, float(up[2] / np.linalg.norm(up)))
    return Way(float(np.arccos(lowest)), hardest)


def check_carrying(
    robot: RobotModel, task: Task, solution: Solution, q_rest: Array, tolerances: Tolerances
) -> list[str]:
    """Where the object leans, or is accelerated, by more than the task allows."""
    if task.up is None and not np.isfinite(task.max_acceleration):
        return []
    found, way = [], way_of_object(robot, task, solution, q_rest)
    if way.tilt > task.max_tilt + tolerances.tilt:
        leant, most = np.rad2deg([way.tilt, task.max_tilt])
        found.append(f"carry: tilted by {leant:.3f}°, allowed {most:.3f}°")
    if way.acceleration > task.max_acceleration * (1.0 + tolerances.limit):
        found.append(
            f"carry: accelerated by {way.acceleration:.4g}, allowed {task.max_acceleration:.4g}"
        )
    return found
