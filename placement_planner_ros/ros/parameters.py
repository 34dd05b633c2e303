"""The node's parameters: what there is, what is allowed, and the settings made from them.

Independent of rclpy: `parameter_server.py` declares these on a node.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import (
    GraspError,
    ObjectError,
    ParameterError,
    PlacementPlannerError,
)
from placement_planner_ros.core.objective.by_name import objective_names
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import GRIPPER_JOINTS, GRIPPER_OPEN, TIP_FRAMES

Kind = Literal["bool", "integer", "double", "string", "double[]", "integer[]", "string[]"]
Value = bool | int | float | str | list[float] | list[int] | list[str]

_DEFAULTS = PlannerSettings()
_GRID = GridSettings()
_SCENE = scene_by_name("cabinet_high_clutter")
_MAX_SEED = 2**63 - 1


@dataclass(frozen=True, slots=True)
class Spec:
    """One parameter.

    Attributes:
        name: as users set it.
        kind: its type; where it is a double, integers are accepted.
        default: its value when nothing is set.
        text: what it means, one sentence.
        unit: of its numbers, '' where there is none.
        lower, upper: bounds of each of its numbers, inclusive.
        length: how many elements a list has; -1 for any.
        choices: names a string may have.
        startup: read once at start-up; refused afterwards.
        check: raises a PlacementPlannerError where the value alone shows that it is bad.
    """

    name: str
    kind: Kind
    default: Value
    text: str
    unit: str = ""
    lower: float = -math.inf
    upper: float = math.inf
    length: int = -1
    choices: Callable[[], Sequence[str]] | None = None
    startup: bool = False
    check: Callable[[str, Any], None] | None = None

    def convert(self, value: object) -> Value:
        """The value in this parameter's type.

        Raises:
            ParameterError: wrong type or length, not finite, or outside the range.
        """
        if self.kind.endswith("[]"):
            if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
                raise ParameterError(self.name, value, f"give a list: {self.text}")
            converted: Any = [self._element(v) for v in value]
            if self.length >= 0 and len(converted) != self.length:
                raise ParameterError(
                    self.name, converted, f"give {self.length} values: {self.text}"
                )
        else:
            converted = self._element(value)
        if self.check is not None:
            self.check(self.name, converted)
        return converted

    def _element(self, value: object) -> bool | int | float | str:
        kind = self.kind.removesuffix("[]")
        accepted = {
            "bool": isinstance(value, (bool, np.bool_)),
            "integer": isinstance(value, (int, np.integer)) and not isinstance(value, bool),
            "double": isinstance(value, (int, float, np.number)) and not isinstance(value, bool),
            "string": isinstance(value, str),
        }
        if not accepted[kind]:
            raise ParameterError(self.name, value, f"give {_AN[kind]}: {self.text}")
        if kind == "string":
            if self.choices is not None and value not in self.choices():
                raise ParameterError(self.name, value, f"choose one of {', '.join(self.choices())}")
            return str(value)
        if kind == "bool":
            return bool(value)
        number: Any = value
        if not math.isfinite(number):
            raise ParameterError(self.name, number, f"must be finite: {self.text}")
        if not self.lower <= number <= self.upper:
            raise ParameterError(
                self.name, number, f"must lie in [{self.lower:g}, {self.upper:g}] {self.unit}"
            )
        return int(number) if kind == "integer" else float(number)


_AN = {
    "bool": "true or false",
    "integer": "an integer",
    "double": "a number",
    "string": "a string",
}


def _poses(name: str, value: Sequence[float]) -> None:
    poses_from_list(name, value)


def poses_from_list(name: str, values: Sequence[float]) -> tuple[pin.SE3, ...]:
    """Poses from x y z qx qy qz qw, one after the other.

    Raises:
        GraspError: not a multiple of seven numbers, or a quaternion that is not of unit length.
    """
    if len(values) % 7 != 0:
        raise GraspError(name, list(values), "give seven numbers per pose: x y z qx qy qz qw")
    poses = []
    for pose in np.array(values, dtype=np.float64).reshape(-1, 7):
        length = float(np.linalg.norm(pose[3:]))
        if not abs(length - 1.0) < 1e-2:
            raise GraspError(
                name, pose.tolist(), f"the quaternion x y z w must have length 1, not {length:.3g}"
            )
        quaternion = pin.Quaternion(pose[3:] / length)
        poses.append(pin.SE3(quaternion.toRotationMatrix(), pose[:3]))
    return tuple(poses)


def _one_pose(name: str, value: Sequence[float]) -> None:
    if value and len(value) != 7:
        raise ParameterError(name, value, "give seven numbers: x y z qx qy qz qw")
    try:
        poses_from_list(name, value)
    except GraspError as error:
        raise ParameterError(error.field, error.value, error.remedy) from error


def _volume(name: str, value: Sequence[float]) -> None:
    TargetVolume(np.array(value[:3]), np.array(value[3:]))


def _center(name: str, value: Sequence[float]) -> None:
    if len(value) not in (0, 3):
        raise ParameterError(name, value, "give x y z, or nothing")


def _names(name: str, value: Sequence[str]) -> None:
    for each in value:
        if not each or any(character.isspace() for character in each):
            raise ParameterError(name, list(value), "give names that are not empty, without spaces")


def _triples(name: str, value: Sequence[float]) -> None:
    if len(value) % 3 != 0:
        raise ObjectError(name, f"{len(value)} numbers", "give three for each")


def _scale(name: str, value: float) -> None:
    if not value > 0.0:
        raise ParameterError(name, value, "must be above zero")


def _share(name: str, value: float) -> None:
    if not 0.0 < value <= 1.0:
        raise ParameterError(name, value, "must be above 0 and at most 1")


# Parameters that are fields of the planner's settings: name -> group in PlannerSettings.
_SETTINGS = {
    "collision_margin": "collision",
    "contact_tolerance": "collision",
    "approach_distance": "approach",
    "retreat_distance": "retreat",
    "velocity_scaling": "execution",
    "acceleration_scaling": "execution",
    "acceleration_limits": "execution",
    "selection": "sampling",
}


def _setting(name: str) -> Any:
    default = getattr(getattr(_DEFAULTS, _SETTINGS[name]), name)
    return list(default) if isinstance(default, tuple) else default


def _start_up() -> list[Spec]:
    return [
        Spec(
            "robot_description",
            "string",
            "",
            "URDF text, a path or a package:// URI; empty: the topic robot_description, "
            "and the bundled YuMi until one arrives there.",
            startup=True,
        ),
        Spec(
            "robot_description_semantic",
            "string",
            "",
            "SRDF text, a path or a package:// URI: link pairs that self-collision checks leave "
            "out. Optional.",
            startup=True,
        ),
        Spec(
            "planning_frame",
            "string",
            "",
            "Frame of target_volume and of all results, z up; empty: the robot's root link.",
            startup=True,
        ),
        Spec(
            "cloud_topics",
            "string[]",
            [],
            "Topics with clouds of the environment, besides points.",
            startup=True,
        ),
        Spec(
            "sensor_frames",
            "string[]",
            [],
            "Frames of clouds whose poses are given as sensor_poses.<frame>.",
            startup=True,
            check=_names,
        ),
    ]


def _changeable() -> list[Spec]:
    return [
        Spec(
            "target_volume",
            "double[]",
            [*map(float, _SCENE.volume.lower), *map(float, _SCENE.volume.upper)],
            "Minimum and maximum corner of the target volume V in planning_frame.",
            "m",
            length=6,
            check=_volume,
        ),
        Spec(
            "objective",
            "string",
            "maximize_clearance",
            "What to maximise: maximize_clearance, minimize_clearance, or the name of an entry "
            "point in the group placement_planner_ros.objectives.",
            choices=objective_names,
        ),
        Spec(
            "time_limit",
            "double",
            30.0,
            "Time after which a run ends, by a steady clock; 0: it runs until stopped.",
            "s",
            0.0,
            1e6,
        ),
        Spec(
            "seed",
            "integer",
            -1,
            "Seed of every random choice of a run; -1: from the machine's entropy.",
            "",
            -1,
            _MAX_SEED,
        ),
        Spec(
            "sampler",
            "string",
            _DEFAULTS.sampler,
            "How goals are sampled.",
            choices=lambda: ("mcts", "uniform"),
        ),
        Spec(
            "selection",
            "string",
            _setting("selection"),
            "Where the sampler mcts looks next: by optimistic search over cells, or by UCB1 as in "
            "the paper.",
            choices=lambda: ("optimistic", "ucb1"),
        ),
        Spec(
            "local_optimization",
            "bool",
            _DEFAULTS.local_optimization,
            "Whether each placement is optimised locally before it is published.",
        ),
        Spec(
            "collision_margin",
            "double",
            _setting("collision_margin"),
            "Distance that arm, hand and object keep from obstacles.",
            "m",
            0.0,
            0.1,
        ),
        Spec(
            "contact_tolerance",
            "double",
            _setting("contact_tolerance"),
            "Surface within this distance of the contact plane supports the object.",
            "m",
            1e-4,
            0.02,
        ),
        Spec(
            "approach_distance",
            "double",
            _setting("approach_distance"),
            "Length of the straight way down onto the support; shorter where there is less room.",
            "m",
            _DEFAULTS.approach.approach_minimum,
            0.5,
        ),
        Spec(
            "retreat_distance",
            "double",
            _setting("retreat_distance"),
            "Length of the straight way that the open hand takes off the placed object.",
            "m",
            0.01,
            0.5,
        ),
        Spec(
            "require_retreat",
            "bool",
            _DEFAULTS.require_retreat,
            "Whether a placement counts only with a certified release and retreat.",
        ),
        Spec(
            "velocity_scaling",
            "double",
            _setting("velocity_scaling"),
            "Share of the joints' velocity limits that is used.",
            "",
            0.0,
            1.0,
            check=_share,
        ),
        Spec(
            "acceleration_scaling",
            "double",
            _setting("acceleration_scaling"),
            "Share of acceleration_limits that is used.",
            "",
            0.0,
            1.0,
            check=_share,
        ),
        Spec(
            "acceleration_limits",
            "double[]",
            _setting("acceleration_limits"),
            "One limit for all joints, or one for each joint of the arm.",
            "rad/s^2 or m/s^2",
            1e-3,
            1e4,
        ),
        Spec(
            "trajectory_joints",
            "string",
            "arm",
            "Which joints trajectories name: the arm's, or all with the others held.",
            choices=lambda: ("arm", "all"),
        ),
        Spec(
            "start_tolerance",
            "double",
            0.02,
            "A robot further from where a run began ends that run.",
            "rad or m",
            1e-4,
            1.0,
        ),
        Spec(
            "joint_state_timeout",
            "double",
            1.0,
            "Joint values older than this are stale.",
            "s",
            0.01,
            3600.0,
        ),
        Spec(
            "cloud.mode",
            "string",
            "latest",
            "latest: the newest cloud of each topic; merge: all clouds since clear_environment.",
            choices=lambda: ("latest", "merge"),
        ),
        Spec(
            "cloud.max_age",
            "double",
            60.0,
            "In mode latest, clouds older than this are stale; 0: any age will do.",
            "s",
            0.0,
            1e6,
        ),
        Spec(
            "cloud.cell_size",
            "double",
            _GRID.cell_size,
            "Edge of the obstacle set's cells.",
            "m",
            0.002,
            0.1,
        ),
        Spec(
            "unknown_space",
            "string",
            "free",
            "What no sensor has seen, by the lines of sight of clouds in their sensor's frame: "
            "free, or occupied, so that nothing enters it.",
            choices=lambda: ("free", "occupied"),
        ),
        Spec(
            "self_filter.enabled",
            "bool",
            True,
            "Whether points on the robot and on the held object are left out of clouds.",
        ),
        Spec(
            "self_filter.padding",
            "double",
            0.02,
            "Points this close to the robot or the held object are left out.",
            "m",
            0.0,
            0.2,
        ),
        Spec(
            "object.mesh",
            "string",
            "",
            "Mesh file of the grasped object, a path or a package:// URI.",
        ),
        Spec(
            "object.vertices",
            "double[]",
            [],
            "Vertices of the grasped object: x y z, one after the other.",
            "m",
            check=_triples,
        ),
        Spec(
            "object.triangles",
            "integer[]",
            [],
            "Triangles of the grasped object: three vertex indices each.",
            "",
            0,
            check=_triples,
        ),
        Spec(
            "object.center_of_mass",
            "double[]",
            [],
            "Centre of mass in the mesh's frame and unit; empty: from the mesh.",
            check=_center,
        ),
        Spec(
            "object.scale",
            "double",
            1.0,
            "Factor from the mesh's unit to metres.",
            "",
            0.0,
            1e6,
            check=_scale,
        ),
    ]


def arms_spec(default: Sequence[str]) -> Spec:
    """The parameter `arms`; at start-up it also says for which arms parameters exist."""
    return Spec(
        "arms",
        "string[]",
        list(default),
        "Arms that could be holding the object, by name.",
        check=_names,
    )


def arm_specs(arm: str, *, yumi: bool) -> list[Spec]:
    """Parameters of one arm; `yumi` chooses the bundled robot's values as defaults."""
    known = yumi and arm in TIP_FRAMES
    return [
        Spec(
            f"{arm}.tip_frame",
            "string",
            TIP_FRAMES[arm] if known else "",
            "Link that the arm's grasps refer to.",
        ),
        Spec(
            f"{arm}.joints",
            "string[]",
            [],
            "The arm's joints, root to tip; empty: every movable joint on the way to the tip.",
        ),
        Spec(
            f"{arm}.grasps",
            "double[]",
            [],
            "Poses of the object in the tip frame: x y z qx qy qz qw, one after the other.",
            "m",
            check=_poses,
        ),
        Spec(
            f"{arm}.touch_links",
            "string[]",
            [],
            "Links that may touch the held object; empty: the hand's, from the URDF.",
        ),
        Spec(
            f"{arm}.gripper_joints",
            "string[]",
            [GRIPPER_JOINTS[arm]] if known else [],
            "Joints that open the hand.",
        ),
        Spec(
            f"{arm}.gripper_open",
            "double[]",
            [GRIPPER_OPEN] if known else [],
            "Values of gripper_joints when the hand is open.",
            "rad or m",
        ),
    ]


def sensor_pose_spec(frame: str) -> Spec:
    """Pose of one declared sensor frame."""
    return Spec(
        f"sensor_poses.{frame}",
        "double[]",
        [],
        "Pose of the frame in planning_frame: x y z qx qy qz qw; empty: not given.",
        "m",
        check=_one_pose,
    )


def fixed_specs() -> list[Spec]:
    """Every parameter whose name does not depend on another's value."""
    return [*_start_up(), *_changeable()]


class ParameterSet:
    """Specifications and a consistent set of values; immutable.

    Args:
        specs: every parameter.
        values: by name; defaults where one is missing.

    Raises:
        PlacementPlannerError: a value, or the values together, are bad.
    """

    def __init__(
        self, specs: Mapping[str, Spec], values: Mapping[str, object] | None = None
    ) -> None:
        self.specs = specs
        self._values = {name: spec.default for name, spec in specs.items()}
        for name, value in (values or {}).items():
            self._values[name] = specs[name].convert(value)
        self._check_together()

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def changed(self, changes: Mapping[str, object]) -> ParameterSet:
        """A copy with some values replaced.

        Raises:
            PlacementPlannerError: an unknown name, a start-up parameter, or a bad value.
        """
        for fault in self._alone(changes):
            raise fault
        if not changes:
            return self
        # What is here has been checked: that a start is quick, only the changes are.
        other = copy.copy(self)
        other._values = self._values | {n: self.specs[n].convert(v) for n, v in changes.items()}
        other._check_together()
        return other

    def faults(self, changes: Mapping[str, object]) -> list[PlacementPlannerError]:
        """Everything for which `changed` would refuse these changes."""
        faults = self._alone(changes)
        if not faults:
            try:
                self.changed(changes)
            except PlacementPlannerError as error:
                faults.append(error)
        return faults

    def _alone(self, changes: Mapping[str, object]) -> list[PlacementPlannerError]:
        """What is wrong with each change by itself."""
        faults: list[PlacementPlannerError] = []
        for name, value in changes.items():
            if name not in self.specs:
                faults.append(ParameterError(name, value, "there is no such parameter"))
            elif self.specs[name].startup:
                faults.append(ParameterError(name, value, "is read at start-up; set it there"))
            else:
                try:
                    self.specs[name].convert(value)
                except PlacementPlannerError as error:
                    faults.append(error)
        return faults

    @property
    def planner_settings(self) -> PlannerSettings:
        """Settings of the planner."""
        groups: dict[str, dict[str, Any]] = {}
        for name, group in _SETTINGS.items():
            value = self[name]
            groups.setdefault(group, {})[name] = tuple(value) if isinstance(value, list) else value
        return replace(
            _DEFAULTS,
            sampler=self["sampler"],
            local_optimization=self["local_optimization"],
            require_retreat=self["require_retreat"],
            **{group: replace(getattr(_DEFAULTS, group), **v) for group, v in groups.items()},
        )

    @property
    def grid_settings(self) -> GridSettings:
        """Settings of the obstacle set."""
        return replace(_GRID, cell_size=self["cloud.cell_size"])

    @property
    def volume(self) -> TargetVolume:
        """V."""
        corners = np.array(self["target_volume"])
        return TargetVolume(corners[:3], corners[3:])

    def sensor_pose(self, frame: str) -> pin.SE3 | None:
        """Pose of a sensor's frame in the planning frame, where one is given."""
        name = f"sensor_poses.{frame}"
        if name not in self.specs or not self[name]:
            return None
        return poses_from_list(name, self[name])[0]

    def _check_together(self) -> None:
        for arm in self["arms"]:
            if f"{arm}.tip_frame" not in self.specs:
                raise ParameterError(
                    "arms",
                    arm,
                    "this arm was not among arms at start-up, so it has no parameters",
                )
        if len(set(self["arms"])) != len(self["arms"]):
            raise ParameterError("arms", self["arms"], "name each arm once")
        if not self["arms"]:
            raise ParameterError("arms", self["arms"], "name at least one arm")
        _ = self.planner_settings, self.grid_settings
