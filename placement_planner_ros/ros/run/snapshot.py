"""The snapshot of all inputs that a run begins with."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.parameters.values import ParameterSet


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Every input of a run, taken at one moment and never changed.

    Attributes:
        q_start: (nq,) q_0.
        clouds: point sets (n, 3) in the planning frame.
        parameters: of this run.
        frame: the planning frame.
        origins: per cloud, (3,) where its sensor was, None where that is not known.
        placed: per cloud, whether it is known rather than measured: an object placed before,
            furniture, or one of `~/known_objects`. It is never filtered.
        object_key: `ObjectInput.key` of what the robot holds by default, which this run may
            hold another in place of.
        robot_key: `RobotInput.key` of the robot.
        joints: whose values it was taken of, which must stay fresh.
        moving: those of them that moved already, which may leave q_0.
        notes: what to know of q_0.
        fixed: which links are furniture and which the robot's foot, in words; empty where none is
            furniture.
        known_changes: `KnownObjects.changes`.
        topics: per cloud, where it is the newest of a topic; empty for others.
        times: per cloud, when it was taken, s of the steady clock; 0 for others.
        of_clouds: what is wrong with clouds that are taken all the same, in words.
    """

    robot: Robot
    arms: tuple[Arm, ...]
    q_start: Array
    body: Body
    clouds: tuple[Array, ...]
    parameters: ParameterSet
    frame: str
    origins: tuple[Array | None, ...] = ()
    placed: tuple[bool, ...] = ()
    object_key: Hashable = None
    robot_key: Hashable = None
    joints: tuple[str, ...] = ()
    moving: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    fixed: str = ""
    known_changes: int = 0
    of_clouds: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()
    times: tuple[float, ...] = ()
