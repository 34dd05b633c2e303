"""The share of a motion that leads through space that no sensor looked at."""

from __future__ import annotations

import functools

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.collision.shapes import ConvexSet, link_shapes
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.timing.quintic import positions_at
from placement_planner_ros.core.types import Array, Index, Trajectory

SPACING_M = 0.02
"""m between the points that stand for what moves, and that they move from look to look."""


def unseen_share(
    problem: Problem, arm: Arm, grasp: int, to: Trajectory, back: Trajectory | None
) -> float | None:
    """Of the ways of all points of arm, hand and held object, how much is where no sensor looked.

    Unseen is what `SeenSpace.unseen` says, but where the robot and the object are at the start.

    Args:
        to: from the problem's start, with the object in that grasp.
        back: the retreat without it; None without one.

    Returns:
        0 to 1, by length; None where no sensor's place is known.
    """
    robot, q_start, space = problem.robot, problem.q_start, problem.environment.seen_space
    if space is None:
        return None
    T_tip_object = arm.grasps[grasp]
    held = _thinned(problem.body.volume_points) @ T_tip_object.rotation.T + T_tip_object.translation
    own = _moving_points(robot, arm)
    tip = robot.model.frames[robot.frame_id(arm.tip_frame)]
    in_joint = held @ tip.placement.rotation.T + tip.placement.translation
    began: Index | None = None
    unseen = length = 0.0
    for path, q, points in (
        (to, q_start, [*own, (tip.parentJoint, in_joint)]),
        (back, robot.with_open_hand(q_start, arm), own),
    ):
        if path is None:
            continue
        at = _along(robot, arm, q, path, points)
        if began is None:
            began = np.unique(_blocks(at[0]))
        moved = np.linalg.norm(np.diff(at, axis=0), axis=2).ravel()
        reached = at[1:].reshape(-1, 3)
        rows = np.flatnonzero(space.unseen(reached))
        rows = rows[~np.isin(_blocks(reached[rows]), began)]
        unseen += float(moved[rows].sum())
        length += float(moved.sum())
    return unseen / length if length > 0.0 else 0.0


def _along(
    robot: Robot, arm: Arm, q: Array, path: Trajectory, points: list[tuple[int, Array]]
) -> Array:
    """(k, n, 3) all points, of the joints that carry them, from look to look along a path."""
    data = robot.model.createData()

    def placed(times: Array) -> Array:
        at = np.empty((len(times), sum(len(each) for _, each in points), 3))
        q_all = np.array(q)
        for row, positions in enumerate(positions_at(path, times)):
            q_all[arm.q_index] = positions
            pin.forwardKinematics(robot.model, data, q_all)
            first = 0
            for joint, each in points:
                T = data.oMi[joint]
                at[row, first : first + len(each)] = each @ T.rotation.T + T.translation
                first += len(each)
        return at

    # How far points move, by the curve's own points; then looks that are so far apart.
    moved = np.linalg.norm(np.diff(placed(path.times), axis=0), axis=2).max(axis=1)
    so_far = np.concatenate([[0.0], moved.cumsum()])
    looks = int(so_far[-1] / SPACING_M) + 2
    return placed(np.interp(np.linspace(0.0, so_far[-1], looks), so_far, path.times))


@functools.lru_cache(maxsize=8)
def _moving_points(robot: Robot, arm: Arm) -> list[tuple[int, Array]]:
    """Points that fill the links which the arm moves, by the joint that carries them."""
    model = robot.model
    joints = {model.getJointId(name) for name in arm.joints}
    points: list[tuple[int, Array]] = []
    for thing, shape in zip(robot.geometry.geometryObjects, link_shapes(robot), strict=True):
        if joints.isdisjoint(model.supports[thing.parentJoint]):
            continue
        T = thing.placement
        inside = _thinned(np.vstack([_filling(each) for each in shape.sets]))
        points.append((thing.parentJoint, inside @ T.rotation.T + T.translation))
    return points


def _filling(convex: ConvexSet) -> Array:
    """(n, 3) points of a grid that lie in a convex set, round ones taken for the box around, and
    its middle."""
    low, high = convex.vertices.min(axis=0), convex.vertices.max(axis=0)
    middle = 0.5 * (low + high)
    steps = np.floor((0.5 * (high - low) + convex.radius) / SPACING_M)
    axes = [np.arange(-n, n + 1.0) * SPACING_M for n in steps]
    grid = middle + np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = (grid @ convex.normals.T <= convex.offsets + convex.radius).all(axis=1)
    return np.vstack([grid[inside], middle])


def _thinned(points: Array) -> Array:
    """One of (n, 3) points in each block."""
    return np.asarray(points[np.unique(_blocks(points), return_index=True)[1]])


def _blocks(points: Array) -> Index:
    """(n,) numbers of the blocks, as wide as the spacing, that points (n, 3) lie in."""
    i, j, k = np.floor(points / SPACING_M).astype(np.int64).T + (1 << 20)
    return np.asarray((i << 42) | (j << 21) | k)
