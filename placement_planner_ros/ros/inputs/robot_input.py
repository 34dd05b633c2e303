"""The robot the node plans for: from a parameter, a topic, or the bundled YuMi."""

from __future__ import annotations

import threading
import xml.etree.ElementTree as ET
from collections.abc import Callable, Hashable, Iterable
from pathlib import Path

import pinocchio as pin

from placement_planner_ros.core.errors import PlacementPlannerError, RobotError
from placement_planner_ros.core.robot.geometry import read_mesh
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.mesh_files import Triangles, check_header
from placement_planner_ros.ros.inputs.mesh_process import MeshProcess
from placement_planner_ros.ros.inputs.reading import Reading, ShouldStop, State
from placement_planner_ros.ros.inputs.resources import Files, description_text
from placement_planner_ros.ros.parameters.checks import poses_from_list
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.share import share_path

FramePose = Callable[[str, str], pin.SE3 | None]
"""T_a_b of two frames outside the URDF (tf2), or None where nobody knows."""


class DescriptionError(RobotError):
    """The robot's description cannot be read."""

    code = "BAD_ROBOT"


class RobotInput:
    """Reads robot descriptions, in the background. Safe to use from several threads.

    Until a description comes by topic the bundled YuMi stands in for it. From then on only the
    newest counts: while it is read there is no robot, and none where it cannot be.

    Args:
        parameters: as at start-up.
        frame_pose: asked where planning_frame is no link of the robot.
        files: finds the meshes that descriptions name.

    Raises:
        RobotError: a description named by a parameter is not there.
    """

    def __init__(self, parameters: ParameterSet, frame_pose: FramePose, files: Files) -> None:
        self._lock = threading.Lock()
        self._frame = str(parameters["planning_frame"])
        self._frame_pose = frame_pose
        self._files = files
        self._reading: Reading[Robot] = Reading("robot", _explain)
        self._joints: frozenset[str] = frozenset()
        given = parameters["robot_description"]
        semantic = parameters["robot_description_semantic"]
        self.follows_topic = not given
        self.follows_semantic_topic = not semantic
        self._arrived = False
        self._srdf: str | None = None
        if given:
            self._urdf, self._beside = description_text("robot_description", given, files)
        else:
            self._beside = share_path("urdf", "yumi.urdf")
            self._urdf = self._beside.read_text(encoding="utf-8")
            self._srdf = share_path("urdf", "yumi.srdf").read_text(encoding="utf-8")
        if semantic:
            self._srdf, _ = description_text("robot_description_semantic", semantic, files)
        self._key = self._begin()

    def set_description(self, urdf: str) -> bool:
        """Take a URDF from the topic; False where it is the one in use, or being read."""
        with self._lock:
            self._arrived = True
            if urdf == self._urdf and self.state != "bad":
                return False
            if urdf != self._urdf and self.follows_semantic_topic:
                self._srdf = None
            self._urdf, self._beside = urdf, None
            self._reread()
        return True

    def set_semantic(self, srdf: str) -> bool:
        """Take an SRDF from the topic; False where it is the one in use, or being read."""
        with self._lock:
            if srdf == self._srdf and self.state != "bad":
                return False
            self._srdf = srdf
            self._reread()
        return True

    @property
    def robot(self) -> Robot:
        """The robot, its root frame being the planning frame.

        Raises:
            NotReadyError: the newest description is being read.
            PlacementPlannerError: it is unusable.
        """
        return self._reading.get(self._key)

    @property
    def state(self) -> State:
        """Whether there is a robot, as `~/status` says it."""
        return self._reading.state(self._key)

    @property
    def key(self) -> Hashable:
        """Another one whenever another description is given."""
        return self._key

    @property
    def is_given(self) -> bool:
        """Whether this is the robot meant, rather than a stand-in until one arrives."""
        return not self.follows_topic or self._arrived

    @property
    def joint_names(self) -> frozenset[str]:
        """Movable joints of the newest robot that could be read."""
        return self._joints

    @property
    def reading(self) -> Reading[Robot]:
        """Where descriptions are read."""
        return self._reading

    def wait(self, patience: float | None = None) -> None:
        """Return once the newest description is read, or cannot be."""
        self._reading.wait(self._key, patience)

    def _reread(self) -> None:
        """Begin to read what is given now, and stop reading what was; lock held."""
        self._reading.forget(self._key)
        self._key = self._begin()

    def _begin(self) -> Hashable:
        urdf, srdf, beside = self._urdf, self._srdf, self._beside
        trusted = not self._arrived

        def read(should_stop: ShouldStop) -> Robot:
            with MeshProcess(should_stop) as process:
                meshes = _Meshes(self._files, process, trusted, beside)
                robot = self._read(urdf, srdf, meshes)
            self._joints = frozenset(robot.joint_names)
            return robot

        key = object()  # the same text is read anew where it could not be before
        self._reading.want(key, read, lasting=True)
        return key

    def _read(self, urdf: str, srdf: str | None, meshes: _Meshes) -> Robot:
        try:
            robot = Robot.from_urdf(urdf, meshes, srdf)
            if self._frame in ("", robot.root_link):
                return robot
            T_planning_root = self._root_in_planning_frame(robot)
            urdf = _with_root(urdf, self._frame, robot.root_link, T_planning_root)
            return Robot.from_urdf(urdf, meshes, srdf)
        except RobotError as error:
            raise DescriptionError(error.field, error.value, error.remedy) from error

    def _root_in_planning_frame(self, robot: Robot) -> pin.SE3:
        if robot.model.existFrame(self._frame, pin.FrameType.BODY):
            frame = robot.model.frames[robot.frame_id(self._frame)]
            if frame.parentJoint != 0:
                raise RobotError(
                    "planning_frame", self._frame, "moves; name a frame fixed to the robot's root"
                )
            return pin.SE3(frame.placement.inverse())
        T_planning_root = self._frame_pose(self._frame, robot.root_link)
        if T_planning_root is None:
            raise RobotError(
                "planning_frame",
                self._frame,
                f"is no link of robot {robot.name!r}, and tf2 does not know it either",
            )
        return T_planning_root


class _Meshes:
    """The meshes of one description."""

    def __init__(
        self, files: Files, process: MeshProcess, trusted: bool, beside: Path | None
    ) -> None:
        self._files = files
        self._process = process
        self._trusted = trusted
        self._beside = beside

    def find(self, uri: str) -> Path:
        """The file that a mesh's URI names."""
        path = self._files.find(uri, trusted=self._trusted, beside=self._beside)
        check_header(path)
        return path

    def read(self, path: Path) -> tuple[Array, Triangles]:
        """Vertices and triangles of a file."""
        if path.resolve().is_relative_to(share_path("urdf").resolve()):
            return read_mesh(path)  # the bundled robot's, known to be good
        return self._process.read(path, "link")


def _explain(error: Exception) -> PlacementPlannerError:
    words = f"cannot be read: {type(error).__name__}: {error}"
    return DescriptionError("robot_description", "the newest", words)


def _with_root(urdf: str, frame: str, root_link: str, T_frame_root: pin.SE3) -> str:
    """The URDF with a new root link that carries the old one."""
    tree = ET.fromstring(urdf)
    taken = tree.find(f"link[@name='{frame}']")
    if taken is not None:
        # The planning frame is a link of the robot: the new root takes its name, so the link
        # itself needs another.
        renamed = f"{frame}_of_robot"
        for element in tree.iter():
            for key in ("link", "name") if element.tag in ("parent", "child", "link") else ():
                if element.get(key) == frame:
                    element.set(key, renamed)
    ET.SubElement(tree, "link", name=frame)
    joint = ET.SubElement(tree, "joint", name=f"{frame}_to_{root_link}", type="fixed")
    ET.SubElement(joint, "parent", link=frame)
    ET.SubElement(joint, "child", link=root_link)
    xyz = " ".join(f"{v:.17g}" for v in T_frame_root.translation)
    rpy = " ".join(f"{v:.17g}" for v in pin.rpy.matrixToRpy(T_frame_root.rotation))
    ET.SubElement(joint, "origin", xyz=xyz, rpy=rpy)
    return ET.tostring(tree, encoding="unicode")


def make_arms(robot: Robot, parameters: ParameterSet) -> tuple[Arm, ...]:
    """The candidate arms that the parameters describe.

    Raises:
        RobotError: an arm does not fit the robot.
        GraspError: a grasp is bad.
    """
    return tuple(make_arm(robot, parameters, name) for name in parameters["arms"])


def make_arm(robot: Robot, parameters: ParameterSet, name: str) -> Arm:
    """The arm of that name.

    Raises:
        RobotError: it does not fit the robot.
        GraspError: a grasp is bad.
    """
    tip = parameters[f"{name}.tip_frame"]
    if not tip:
        raise RobotError(f"{name}.tip_frame", tip, "name the link that the grasps refer to")
    return robot.arm(
        name,
        tip,
        joints=parameters[f"{name}.joints"] or None,
        grasps=poses_from_list(f"{name}.grasps", parameters[f"{name}.grasps"]),
        touch_links=parameters[f"{name}.touch_links"] or None,
        gripper_joints=parameters[f"{name}.gripper_joints"],
        gripper_open=parameters[f"{name}.gripper_open"],
    )


def require_known(robot: Robot, parameters: ParameterSet, names: Iterable[str]) -> None:
    """Refuse links and joints of these parameters that the robot does not have.

    Raises:
        RobotError: there is one.
    """
    arms = parameters["arms"]
    links = {f"{arm}.{part}" for arm in arms for part in ("tip_frame", "touch_links")}
    joints = {f"{arm}.{part}" for arm in arms for part in ("joints", "gripper_joints")}
    for name in names:
        value = parameters[name] if name in links | joints else []
        for each in filter(None, [value] if isinstance(value, str) else value):
            if name in links and not robot.model.existFrame(each, pin.FrameType.BODY):
                raise RobotError(name, each, f"is no link of robot {robot.name!r}")
            if name in joints and each not in robot.joint_names:
                raise RobotError(name, each, f"is no movable joint of robot {robot.name!r}")
