"""The robot the node plans for: from a parameter, a topic, or the bundled YuMi."""

from __future__ import annotations

import threading
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable

import pinocchio as pin

from placement_planner_ros.core.errors import (
    PlacementPlannerError,
    RobotError,
)
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.ros.inputs.resources import description_text, package_dirs
from placement_planner_ros.ros.parameters.checks import poses_from_list
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.share import share_path

FramePose = Callable[[str, str], pin.SE3 | None]
"""T_a_b of two frames outside the URDF (tf2), or None where nobody knows."""


class RobotInput:
    """Reads robot descriptions. Safe to use from several threads.

    Args:
        parameters: as at start-up.
        frame_pose: asked where planning_frame is no link of the robot.

    Raises:
        RobotError: the description named by a parameter is unusable.
    """

    def __init__(self, parameters: ParameterSet, frame_pose: FramePose) -> None:
        self._lock = threading.Lock()
        self._frame = str(parameters["planning_frame"])
        self._frame_pose = frame_pose
        given = parameters["robot_description"]
        semantic = parameters["robot_description_semantic"]
        self.follows_topic = not given
        self.follows_semantic_topic = not semantic
        if given:
            self._urdf = description_text("robot_description", given)
            self._srdf: str | None = None
        else:
            self._urdf = share_path("urdf", "yumi.urdf").read_text(encoding="utf-8")
            self._srdf = share_path("urdf", "yumi.srdf").read_text(encoding="utf-8")
        if semantic:
            self._srdf = description_text("robot_description_semantic", semantic)
        self._arrived = False
        self._error: PlacementPlannerError | None = None
        self._robot = self._read()

    def set_description(self, urdf: str) -> Robot | None:
        """Take a URDF from the topic; None where it is the one in use.

        Raises:
            PlacementPlannerError: it is unusable; `robot` raises the same until a better one comes.
        """
        with self._lock:
            self._arrived = True
            if urdf == self._urdf:
                return None
            self._urdf = urdf
            if self.follows_semantic_topic:
                self._srdf = None
            return self._reread()

    def set_semantic(self, srdf: str) -> Robot | None:
        """Take an SRDF from the topic; None where it is the one in use.

        Raises:
            PlacementPlannerError: it is unusable.
        """
        with self._lock:
            if srdf == self._srdf:
                return None
            self._srdf = srdf
            return self._reread()

    @property
    def robot(self) -> Robot:
        """The robot, its root frame being the planning frame.

        Raises:
            PlacementPlannerError: the newest description is unusable.
        """
        with self._lock:
            if self._error is not None:
                raise self._error
            return self._robot

    @property
    def is_given(self) -> bool:
        """Whether this is the robot meant, rather than a stand-in until one arrives."""
        return not self.follows_topic or self._arrived

    @property
    def planning_frame(self) -> str:
        """The frame of every pose."""
        return self.robot.root_link

    def _reread(self) -> Robot:
        try:
            self._robot = self._read()
        except PlacementPlannerError as error:
            self._error = error
            raise
        self._error = None
        return self._robot

    def _read(self) -> Robot:
        robot = Robot.from_urdf(self._urdf, package_dirs(self._urdf), self._srdf)
        if self._frame in ("", robot.root_link):
            return robot
        T_planning_root = self._root_in_planning_frame(robot)
        urdf = _with_root(self._urdf, self._frame, robot.root_link, T_planning_root)
        return Robot.from_urdf(urdf, package_dirs(urdf), self._srdf)

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
