"""Robot, object and sensors of the page, made from what it hears."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.meshes.read import UNREADABLE, read_mesh
from placement_planner_ros.core.types import Array, Index
from placement_planner_ros.playback import pose_of_numbers
from placement_planner_ros.ros.inputs.mesh_message import mesh_from_lists, mesh_from_message
from placement_planner_ros.ros.inputs.resources import Files, description_text
from placement_planner_ros.share import share_path
from placement_planner_ros.view.listening import Listener
from placement_planner_ros.view.robot import ShownRobot
from placement_planner_ros.view.robot_shapes import Surface


class Itself:
    """A thing that is the same as nothing but itself, kept: the `id` of one that is gone may be
    that of the next.

    Args:
        thing: what is kept.
    """

    def __init__(self, thing: object) -> None:
        self._thing = thing

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Itself) and self._thing is other._thing


class World:
    """Robot and object as the node has been given them. Made anew only when these change.

    Attributes:
        robot: None while there is none that can be drawn.
        object: its surface in its own frame; None while there is none.
        faults: what cannot be shown, by what it is.

    Args:
        transform: T_target_source by tf2, None where it is not known.
    """

    def __init__(self, listener: Listener, transform: Callable[[str, str], pin.SE3 | None]) -> None:
        self._listener = listener
        self._transform = transform
        self._robot_key: object = None
        self._object_key: object = None
        self.robot: ShownRobot | None = None
        self.object: Surface | None = None
        self.faults: dict[str, str] = {}

    @property
    def frame(self) -> str:
        """The planning frame."""
        named = str(self._parameters.get("planning_frame", ""))
        return named or ("" if self.robot is None else self.robot.root)

    @property
    def _parameters(self) -> Mapping[str, Any]:
        return self._listener.parameters.values

    def parameter(self, name: str, otherwise: Any) -> Any:
        """One of the node's parameters."""
        value = self._parameters.get(name)
        return otherwise if value is None else value

    def update(self, drawn: Array) -> None:
        """Make robot and object anew where others are given.

        Args:
            drawn: (3 t, 3) corners of the object as the node's markers have it.
        """
        if not self._parameters:
            return
        self._update_robot()
        self._update_object(drawn)

    def _update_robot(self) -> None:
        given, heard = self.parameter("robot_description", ""), self._listener.description
        # what was given as a parameter counts before what comes by topic
        key = (given, "" if given else heard)
        if key == self._robot_key:
            return
        self._robot_key = key
        self.faults.pop("robot", None)
        # As the node takes them: what it was given at start-up is its operator's.
        files, beside, trusted = self._files, None, not heard or bool(given)
        try:
            if given:
                urdf, beside = description_text("robot_description", given, files)
            elif heard:
                urdf = heard
            else:
                beside = share_path("urdf", "yumi.urdf")
                urdf = beside.read_text(encoding="utf-8")
            # the same search for files as the node's own
            self.robot = ShownRobot(
                urdf, lambda uri: files.find(uri, trusted=trusted, beside=beside)
            )
        except (PlacementPlannerError, OSError, ValueError) as error:
            self.robot = None
            self.faults["robot"] = str(error)
        else:
            if self.robot.lacking:
                more = len(self.robot.lacking) - 1
                words = self.robot.lacking[0] + (f"; and {more} more" if more else "")
                self.faults["robot"] = f"not all of it can be drawn: {words}"

    def _update_object(self, drawn: Array) -> None:
        mesh, message = self.parameter("object.mesh", ""), self._listener.object
        vertices = self.parameter("object.vertices", [])
        triangles = self.parameter("object.triangles", [])
        scale = float(self.parameter("object.scale", 1.0))
        # whatever of these is another makes the object another
        key = (mesh, tuple(vertices), tuple(triangles), scale, Itself(message), drawn.tobytes())
        if key == self._object_key:
            return
        self._object_key = key
        self.faults.pop("object", None)
        try:
            if len(drawn):  # what the node has planned for
                faces = np.arange(len(drawn)).reshape(-1, 3)
                self.object = drawn, faces
            # by topic before parameters, as the latest given wins in the node
            elif message is not None:
                self.object = _scaled(*mesh_from_message(message), scale)
            elif vertices and triangles:
                self.object = _scaled(*mesh_from_lists(vertices, triangles), scale)
            elif mesh:
                self.object = _scaled(*read_mesh(self._files.find(mesh, trusted=True)), scale)
            else:
                self.object = None
        except (PlacementPlannerError, *UNREADABLE) as error:
            self.object = None
            self.faults["object"] = str(error)

    @property
    def _files(self) -> Files:
        return Files(self.parameter("package_paths", []), self.parameter("file_roots", []))

    def link_poses(self, positions: Mapping[str, float]) -> Mapping[str, pin.SE3]:
        """T_planning_link of every link; empty where there is no robot."""
        if self.robot is None:
            return {}
        poses = self.robot.link_poses(positions, self.frame)
        if self.frame and not self.robot.has_link(self.frame):
            # a planning frame that is no link: only tf2 knows it
            T_planning_root = self._transform(self.frame, self.robot.root)
            if T_planning_root is not None:
                return {name: T_planning_root * T for name, T in poses.items()}
        return poses

    def held(self, poses: Mapping[str, pin.SE3]) -> list[pin.SE3]:
        """T_planning_object in the first grasp of each arm that could hold it."""
        found = []
        for arm in self.parameter("arms", []):
            tip, grasps = self.tip(arm), self.parameter(f"{arm}.grasps", [])
            # the first grasp stands for all of an arm
            if tip in poses and len(grasps) >= 7:
                found.append(poses[tip] * pose_of_numbers(grasps[:7]))
        return found

    def tip(self, arm: str) -> str:
        """The link that an arm's grasps refer to."""
        return str(self.parameter(f"{arm}.tip_frame", ""))

    def opened(self, arm: str) -> dict[str, float]:
        """Joint values that open an arm's hand."""
        names = self.parameter(f"{arm}.gripper_joints", [])
        values = self.parameter(f"{arm}.gripper_open", [])
        return dict(zip(names, map(float, values), strict=False))

    def frame_pose(self, frame: str, poses: Mapping[str, pin.SE3]) -> pin.SE3 | None:
        """T_planning_frame of a cloud's frame; None where nobody knows it."""
        # declared poses first, then links, then tf2
        pose = self.parameter(f"sensor_poses.{frame}", [])
        if len(pose) == 7:
            return pose_of_numbers(pose)
        if frame == self.frame:
            return pin.SE3.Identity()
        T = poses.get(frame)
        return self._transform(self.frame, frame) if T is None and frame and self.frame else T


def _scaled(vertices: Array, triangles: Index, scale: float) -> Surface:
    """Vertices in metres.

    Raises:
        ValueError: one is not finite: browsers would draw nothing at all.
    """
    if not np.isfinite(vertices).all():
        raise ValueError("it has vertices that are not finite")
    return vertices * scale, triangles
