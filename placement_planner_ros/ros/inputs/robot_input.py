"""The robot the node plans for: from a parameter, a topic, or the bundled YuMi."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Iterable
from functools import partial
from typing import Any

from placement_planner_ros.core.errors import ParameterError, RobotError, listed
from placement_planner_ros.core.meshes.read import Triangles, check_header
from placement_planner_ros.core.robot.announcement import announce_arm
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.weak_cache import weak_lru_cache
from placement_planner_ros.ros.inputs.joint_limits_file import given_joint_limits
from placement_planner_ros.ros.inputs.mesh_process import MeshProcess, cover_in, read_kept
from placement_planner_ros.ros.inputs.reading import Reading, State
from placement_planner_ros.ros.inputs.resources import Files, description_text
from placement_planner_ros.ros.log import Log
from placement_planner_ros.ros.parameters.checks import poses_from_list
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.share import share_path

_PARTS = ("joints", "grasps", "touch_links", "gripper_joints", "gripper_open")
"""Of an arm's parameters, those that are lists."""

LISTED = ("assumed_joints", "world_links", "self_filter.padding_of")
"""Parameters that name joints and links, but for those of arms."""
_NAMED = {
    "tip_frame": "link",
    "touch_links": "link",
    "joints": "movable joint",
    "gripper_joints": "movable joint",
    **dict(zip(LISTED, ("movable joint", "link", "link"), strict=True)),
}
"""What parameters name of a robot; those of an arm without its name."""


class DescriptionError(RobotError):
    """The robot's description cannot be read."""

    code = "BAD_ROBOT"


class RobotInput:
    """Reads robot descriptions, in the background. Safe to use from several threads.

    Until a description comes by topic the bundled YuMi stands in for it. From then on only the
    newest counts: while it is read there is no robot, and none where it cannot be.

    Args:
        parameters: as at start-up.
        files: finds the meshes that descriptions name.
        log: hears of what is read.

    Attributes:
        reading: where descriptions are read.
        joint_names: movable joints of the newest robot that could be read; of these
            `continuous_joints` have no end stops.

    Raises:
        RobotError: a description named by a parameter is not there.
    """

    def __init__(self, parameters: ParameterSet, files: Files, log: Log | None = None) -> None:
        self._lock = threading.Lock()
        self._frame = str(parameters["planning_frame"])
        self._files = files
        self.reading: Reading[Robot] = Reading("robot", DescriptionError, _read_words, log)
        self.joint_names: frozenset[str] = frozenset()
        self.continuous_joints: frozenset[str] = frozenset()
        given = parameters["robot_description"]
        semantic = parameters["robot_description_semantic"]
        self.follows_topic = not given
        self.follows_semantic_topic = not semantic
        self._arrived = False
        self._srdf: str | None = None
        # what the operator names may be anywhere; else the bundled robot stands in
        if given:
            self._urdf, self._beside = description_text("robot_description", given, files)
        else:
            self._beside = share_path("urdf", "yumi.urdf")
            self._urdf = self._beside.read_text(encoding="utf-8")
            self._srdf = share_path("urdf", "yumi.srdf").read_text(encoding="utf-8")
        self._limits = given_joint_limits(parameters, files)
        if semantic:
            self._srdf, _ = description_text("robot_description_semantic", semantic, files)
        self._key = self._begin()

    def set_description(self, urdf: str) -> None:
        """Take a URDF from the topic, unless it is the one in use, or being read."""
        with self._lock:
            self._arrived = True
            if urdf == self._urdf and self.state != "bad":
                return
            # the SRDF of the robot before says nothing of this one
            if urdf != self._urdf and self.follows_semantic_topic:
                self._srdf = None
            self._urdf, self._beside = urdf, None
            self._reread()

    def set_semantic(self, srdf: str) -> None:
        """Take an SRDF from the topic, unless it is the one in use, or being read."""
        with self._lock:
            if srdf != self._srdf or self.state == "bad":
                self._srdf = srdf
                self._reread()

    @property
    def robot(self) -> Robot:
        """The robot, its root frame being the planning frame.

        Raises:
            NotReadyError: the newest description is being read.
            PlacementPlannerError: it is unusable.
        """
        return self.reading.get(self._key)

    @property
    def state(self) -> State:
        """Whether there is a robot, as `~/status` says it."""
        return self.reading.state(self._key)

    @property
    def key(self) -> Hashable:
        """Another one whenever another description is given."""
        return self._key

    @property
    def is_given(self) -> bool:
        """Whether this is the robot meant, rather than a stand-in until one arrives."""
        return not self.follows_topic or self._arrived

    def wait(self, patience: float | None = None) -> None:
        """Return once the newest description is read, or cannot be."""
        self.reading.wait(self._key, patience)

    def _reread(self) -> None:
        """Begin to read what is given now, and stop reading what was; lock held."""
        self.reading.forget(self._key)
        self._key = self._begin()

    def _begin(self) -> Hashable:
        urdf, srdf, beside = self._urdf, self._srdf, self._beside
        # what comes by topic may name files of open folders only
        trusted = not self._arrived

        def read() -> Robot:
            with MeshProcess() as process:
                # meshes are read and covered in another process, where no other has yet
                def mesh_of(uri: str) -> tuple[Array, Triangles]:
                    path = self._files.find(uri, trusted=trusted, beside=beside)
                    check_header(path)
                    return read_kept(process, path)

                try:
                    made = Robot.from_urdf(
                        urdf, mesh_of, srdf, self._limits, partial(cover_in, process)
                    )
                    if self._frame not in ("", made.root_link):
                        made = made.seen_from(self._frame)
                except RobotError as error:
                    of_file = f" of {beside}" if beside and "`urdf`" in error.field else ""
                    field = f"{error.field}{of_file}"
                    raise DescriptionError(field, error.value, error.remedy) from error
            # by these joint states are kept until another robot is read
            self.continuous_joints = made.continuous
            self.joint_names = frozenset(made.joint_names)
            return made

        key = object()  # the same text is read anew where it could not be before
        self.reading.want(key, read, lasting=True)
        return key


def _read_words(robot: Robot) -> str:
    words = f"robot {robot.name!r} read, planning frame {robot.root_link!r}"
    return listed([words, *robot.warnings], "; ")


def make_arm(robot: Robot, parameters: ParameterSet, name: str) -> Arm:
    """The arm of that name.

    Raises:
        RobotError: it does not fit the robot.
        GraspError: a grasp is bad.
    """
    tip = parameters[f"{name}.tip_frame"]
    if not tip:
        raise RobotError(f"{name}.tip_frame", tip, "name the link that the grasps refer to")
    return _arm(robot, name, tip, tuple(tuple(parameters[f"{name}.{part}"]) for part in _PARTS))


@weak_lru_cache("robot", maxsize=16)
def _arm(robot: Robot, name: str, tip: str, parts: tuple[tuple[Any, ...], ...]) -> Arm:
    """Kept from start to start."""
    joints, grasps, touch_links, gripper_joints, gripper_open = parts
    return robot.arm(
        name,
        tip,
        joints=joints or None,
        grasps=poses_from_list(f"{name}.grasps", grasps),
        touch_links=touch_links,
        gripper_joints=gripper_joints,
        gripper_open=gripper_open,
    )


def announced(robot: Robot, parameters: ParameterSet, arm: Arm) -> tuple[str, ...]:
    """What was derived or assumed for an arm of these parameters."""
    chosen = parameters.planner_settings.timing.chosen
    return _announced(robot, arm, not parameters[f"{arm.name}.joints"], not chosen)


@weak_lru_cache("robot", maxsize=16)
def _announced(robot: Robot, arm: Arm, derived: bool, accelerations: bool) -> tuple[str, ...]:
    """Kept from start to start."""
    return announce_arm(robot, arm, derived=derived, accelerations=accelerations)


def require_known(robot: Robot, parameters: ParameterSet, names: Iterable[str]) -> None:
    """Refuse links and joints in these parameters that the robot does not have, assumed joints that
    follow others, and furniture that moves.

    Raises:
        RobotError: there is one, of an arm.
        ParameterError: there is another one.
    """
    for name in names:
        arm, _, part = name.rpartition(".")
        of_arm = arm in parameters["arms"]
        kind, error = _NAMED.get(part if of_arm else name), RobotError if of_arm else ParameterError
        values = [parameters[name]] if part == "tip_frame" else parameters[name]
        for value in filter(None, values) if kind else ():
            # `joint=value` and `link=metres` begin with the name
            each = value.rpartition("=")[0].strip() or value
            there = robot.has_link(each) if kind == "link" else each in robot.joint_names
            if not there:
                raise error(name, each, f"is no {kind} of robot {robot.name!r}")
            if name == "assumed_joints" and each in robot.mimics:
                raise error(name, each, f"follows {robot.mimics[each].master}; give that one")
            if name == "world_links" and robot.joints_to(each):
                raise error(name, each, "a joint moves it; name links that none moves")
