"""Motion planning problems in MoveIt's YAML form: a planning scene and a request to joint values.

Such as those of MotionBenchMaker: boxes and cylinders around a robot of any kind.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.errors import JointStateError, ParameterError
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.core.types import Array, TargetVolume, frozen_array
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.primitives import ConvexPrimitive, box, frustum
from placement_planner_ros.scenes.scenes import Scene

_SIDES = 48
"""Corners of the prism around a cylinder."""
_HAND_LENGTH = 0.3
"""m, how far a hand is taken to extend beyond its tip frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Primitive:
    """A box or cylinder of a planning scene.

    Attributes:
        kind: `box` or `cylinder`.
        size: edges along x, y, z; or length (along z) and radius; metres.
        T_world_primitive: its centre.
    """

    name: str
    kind: str
    size: tuple[float, ...]
    T_world_primitive: pin.SE3

    def solid(self) -> ConvexPrimitive:
        """A convex solid around it: itself, or the prism around the cylinder."""
        if self.kind == "box":
            half = [edge / 2 for edge in self.size]
            upright = box(self.name, [-x for x in half], half, (0.7, 0.7, 0.7))
        else:
            length, radius = self.size
            around = radius / np.cos(np.pi / _SIDES)
            upright = frustum(
                self.name, around, around, -length / 2, length / 2, (0.7, 0.7, 0.7), sides=_SIDES
            )
        T = self.T_world_primitive
        return ConvexPrimitive(self.name, upright.vertices @ T.rotation.T + T.translation)


@dataclass(frozen=True, slots=True, eq=False)
class MotionProblem:
    """From a start state to joint values of one arm, with an empty hand.

    Attributes:
        name: folder and number.
        q_start: (nq,) every joint of the robot.
        q_goal: (dof,) of the arm.
        primitives: the environment.
        notes: joints outside the arm that start beyond their limits, one sentence each.
    """

    name: str
    robot: Robot
    arm: Arm
    q_start: Array
    q_goal: Array
    primitives: tuple[Primitive, ...]
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "q_start", frozen_array(self.q_start, (-1,)))
        object.__setattr__(self, "q_goal", frozen_array(self.q_goal, (self.arm.dof,)))

    @property
    def start(self) -> Array:
        """(dof,) the arm's part of the start state."""
        return np.asarray(self.q_start[self.arm.q_index])

    def obstacles(self, spacing: float = 0.005) -> ObstacleSet:
        """The obstacle set of the primitives' surfaces within the arm's reach.

        Args:
            spacing: of the points, metres.
        """
        chain = Chain.from_robot(self.robot, self.arm, self.q_start)
        reach = _HAND_LENGTH + float(np.linalg.norm(chain.fixed[1:, :3, 3], axis=1).sum())
        base = chain.fixed[0, :3, 3]
        bounds = (base - reach, base + reach)
        solids = tuple(primitive.solid() for primitive in self.primitives)
        scene = Scene(self.name, TargetVolume(*bounds), solids)
        return ObstacleSet.from_points(
            complete_cloud(scene, spacing, bounds), GridSettings(), bounds
        )

    def collision(self) -> ArmCollision:
        """C_free of the arm with an empty hand among the primitives."""
        return ArmCollision(MovingArm(self.robot, self.arm, self.q_start), None, self.obstacles())


def read_problem(
    name: str, scene: Path, request: Path, robot: Robot, tip_frame: str
) -> MotionProblem:
    """Read one problem.

    Args:
        scene: a MoveIt planning scene of boxes and cylinders.
        request: a MoveIt motion plan request with one goal of joint values.
        tip_frame: link at the end of the arm.

    Raises:
        ParameterError: a file holds something else.
        JointStateError: the arm itself starts or shall end beyond its limits.
    """
    world = _load_yaml(scene)
    asked = _load_yaml(request)
    try:
        state = asked["start_state"]["joint_state"]
        q_start = robot.configuration(dict(zip(state["name"], state["position"], strict=True)))
        (goal,) = asked["goal_constraints"]
        wanted = {c["joint_name"]: float(c["position"]) for c in goal["joint_constraints"]}
        things = [
            primitive
            for thing in world["world"]["collision_objects"]
            for primitive in _read_solids(thing)
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise ParameterError(
            "problem", f"{scene}, {request}", f"is not a scene and a request: {error!r}"
        ) from error
    arm = robot.arm(str(asked.get("group_name")), tip_frame, list(wanted))
    q_goal = robot.with_positions(q_start, wanted)
    for where, q in (("start", q_start), ("goal", q_goal)):
        inside = (q[arm.q_index] >= arm.lower) & (q[arm.q_index] <= arm.upper)
        if not inside.all():
            beyond = [n for n, ok in zip(arm.joints, inside, strict=True) if not ok]
            raise JointStateError(f"{name}: {where}", beyond, "must lie within the joint limits")
    return MotionProblem(
        name,
        robot,
        arm,
        q_start,
        q_goal[arm.q_index],
        tuple(things),
        tuple(robot.limit_violations(q_start)),
    )


def panda_problems(data: Path) -> list[MotionProblem]:
    """The problems of every folder `data/problems/*`, with `data/robots/panda_description`.

    Raises:
        ParameterError: there are none, or a file holds something else.
    """
    description = data / "robots" / "panda_description"
    urdf, srdf = description / "urdf" / "panda.urdf", description / "srdf" / "panda.srdf"
    scenes = sorted((data / "problems").glob("*/scene*.yaml"))
    if not scenes or not urdf.is_file() or not srdf.is_file():
        raise ParameterError(
            "data", str(data), "must hold problems/*/scene*.yaml and robots/panda_description"
        )
    robot = Robot.from_urdf(
        urdf.read_text(encoding="utf-8"),
        {"example-robot-data": str(data)},
        srdf.read_text(encoding="utf-8"),
    )
    found = []
    for scene in scenes:
        number = scene.stem.removeprefix("scene")
        request = scene.with_name(f"request{number}.yaml")
        name = f"{scene.parent.name}/{number}"
        found.append(read_problem(name, scene, request, robot, "panda_hand_tcp"))
    return found


def _load_yaml(path: Path) -> Any:
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError) as error:
        raise ParameterError("problem", str(path), f"cannot be read: {error}") from error


def _read_solids(thing: dict[str, Any]) -> list[Primitive]:
    sizes = {"box": 3, "cylinder": 2}
    extra = set(thing) - {"id", "primitives", "primitive_poses"}
    if extra:
        raise ValueError(f"{thing['id']}: only primitives are read, not {sorted(extra)}")
    found = []
    for shape, pose in zip(thing["primitives"], thing["primitive_poses"], strict=True):
        kind, size = str(shape["type"]), tuple(float(x) for x in shape["dimensions"])
        if sizes.get(kind) != len(size) or not min(size) > 0.0:
            raise ValueError(f"{thing['id']}: {kind} {size}; boxes and cylinders are read")
        quaternion = np.array(pose["orientation"], dtype=np.float64)
        quaternion /= np.linalg.norm(quaternion)
        position = np.array(pose["position"], dtype=np.float64)
        T = pin.XYZQUATToSE3(np.concatenate([position, quaternion]))
        found.append(Primitive(str(thing["id"]), kind, size, T))
    return found
