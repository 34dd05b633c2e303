"""The snapshot of all inputs that a run begins with."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.cloud_store import PointSet
from placement_planner_ros.ros.parameters.values import ParameterSet


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Every input of a run, taken at one moment and never changed.

    Attributes:
        q_start: (nq,) q_0.
        parts: the point sets of the surroundings, in the planning frame.
        parameters: of this run.
        frame: the planning frame.
        object_key: `ObjectInput.key` of what the robot holds by default, which this run may
            hold another in place of.
        robot_key: `RobotInput.key` of the robot.
        joints: whose values it was taken of, which must stay fresh.
        moving: those of them that moved already, which may leave q_0.
        notes: what to know of q_0, of links that no joint moves, and of the clouds.
        known_changes: `KnownObjects.changes`.
    """

    robot: Robot
    arms: tuple[Arm, ...]
    q_start: Array
    body: Body
    parts: tuple[PointSet, ...]
    parameters: ParameterSet
    frame: str
    object_key: Hashable = None
    robot_key: Hashable = None
    joints: tuple[str, ...] = ()
    moving: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    known_changes: int = 0

    @property
    def clouds(self) -> tuple[Array, ...]:
        """The points (n, 3) of each part."""
        return tuple(part.points for part in self.parts)

    def arm(self, name: str) -> Arm:
        """The arm of that name."""
        return next(arm for arm in self.arms if arm.name == name)
