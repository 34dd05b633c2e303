"""Whether the best placement still holds, now that newer clouds have come."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.ndimage import binary_dilation

from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.load import Held
from placement_planner_ros.core.problem import workspace
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array, Placement
from placement_planner_ros.ros.inputs.self_filter import outside_robot
from placement_planner_ros.ros.run.snapshot import Snapshot

STEP = 0.02
"""rad or m, the largest joint step between checked configurations."""

FEWEST = 5
"""New points below this number are taken for noise."""


class KnownSpace:
    """The cells of an obstacle set that are occupied, and their neighbours."""

    def __init__(self, obstacles: ObstacleSet) -> None:
        self._origin, self._cell_size = obstacles.origin, obstacles.cell_size
        everywhere = np.ones((3, 3, 3), dtype=bool)
        self._known = binary_dilation(obstacles.index >= 0, structure=everywhere)

    def unknown(self, points: Array) -> Array:
        """Those of (n, 3) points that lie in no known cell."""
        cells = np.floor((points - self._origin) / self._cell_size).astype(np.int64)
        inside = ((cells >= 0) & (cells < self._known.shape)).all(axis=1)
        known = np.zeros(len(points), dtype=bool)
        x, y, z = cells[inside].T
        known[inside] = self._known[x, y, z]
        return np.asarray(points[~known])


def blocked_by(
    points: Array,
    known: KnownSpace,
    placement: Placement,
    snapshot: Snapshot,
    q: Array,
) -> str:
    """What new points of a cloud stand in the placement's way, in words; '' where nothing does.

    Args:
        points: (n, 3) of the newer cloud, planning frame.
        known: what the placement was planned with.
        q: (nq,) the robot's configuration when the cloud was taken.
    """
    robot, arms = snapshot.robot, snapshot.arms
    lower, upper = workspace(
        robot, arms, snapshot.q_start, snapshot.body, snapshot.parameters.volume
    )
    # Elsewhere nothing moves; a stray point far away would make a grid too large to hold.
    near = ((points >= lower) & (points <= upper)).all(axis=1)
    new = known.unknown(points[near])
    if len(new):
        kept = outside_robot(
            new,
            robot,
            q,
            arms,
            snapshot.body,
            snapshot.parameters["self_filter.padding"],
        )
        new = new[kept]
    if len(new) < FEWEST:
        return ""
    settings = snapshot.parameters.planner_settings.collision
    arm = next(a for a in arms if a.name == placement.goal.arm)
    collision = ArmCollision(
        MovingArm(robot, arm, snapshot.q_start),
        Held(snapshot.body, placement.goal.grasp),
        ObstacleSet.from_points(new, snapshot.parameters.grid_settings, None),
        settings,
    )
    for configuration in _dense(placement.trajectory.positions):
        if not collision.free(configuration):
            return f"a newer cloud cuts through it: {collision.explain(configuration)}"
    return ""


def _dense(positions: Array) -> Array:
    """Configurations along the polyline (n, dof), at most `STEP` apart per joint."""
    rows = [positions[:1]]
    for a, b in itertools.pairwise(positions):
        count = max(1, int(np.ceil(np.abs(b - a).max() / STEP)))
        rows.append(a + np.linspace(0.0, 1.0, count + 1)[1:, None] * (b - a))
    return np.vstack(rows)
