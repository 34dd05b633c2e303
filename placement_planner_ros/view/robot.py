"""The robot that is shown: where its links are at given joint values."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.robot.description import build_model, read_urdf
from placement_planner_ros.core.types import Array
from placement_planner_ros.view.robot_shapes import FindFile, link_shapes


class ShownRobot:
    """A robot's links and their shapes; nothing of what planning needs.

    Attributes:
        root: its root link.
        joints: movable joints that mimic no other.
        shapes: surfaces of the links that can be drawn, by their names.
        lacking: in words, what cannot be drawn.

    Args:
        urdf: its text.
        find: finds the mesh files that it names.

    Raises:
        RobotError: the text describes no robot.
    """

    def __init__(self, urdf: str, find: FindFile) -> None:
        root, joints, _ = read_urdf(urdf)
        self._model = build_model(root)
        self._data = self._model.createData()
        # joints that follow others are computed from these
        self._mimics = {name: joint.mimic for name, joint in joints.items() if joint.mimic}
        self.root = str(self._model.frames[1].name)
        self._links = {
            str(frame.name): index
            for index, frame in enumerate(self._model.frames)
            if frame.type == pin.FrameType.BODY
        }
        self.joints = tuple(n for n in self._model.names[1:] if n not in self._mimics)
        self._index = {
            str(name): int(joint.idx_q)
            for name, joint in zip(self._model.names, self._model.joints, strict=True)
        }
        self.shapes, self.lacking = link_shapes(root, find)

    def has_link(self, name: str) -> bool:
        """Whether the robot has a link of that name."""
        return name in self._links

    def configuration(self, positions: Mapping[str, float]) -> Array:
        """q (nq,): joints that are not named are at zero or the limit next to it."""
        # zero where a joint is not told, or its limit next to that
        lower, upper = self._model.lowerPositionLimit, self._model.upperPositionLimit
        q = np.clip(np.zeros(self._model.nq), lower, upper)
        for name in self.joints:
            if name in positions:
                q[self._index[name]] = positions[name]
        for name, mimic in self._mimics.items():
            q[self._index[name]] = mimic.multiplier * q[self._index[mimic.master]] + mimic.offset
        return np.asarray(q)

    def link_poses(
        self, positions: Mapping[str, float], planning_frame: str = ""
    ) -> Mapping[str, pin.SE3]:
        """T_planning_link of every link.

        Args:
            positions: of joints, rad or m; see `configuration`.
            planning_frame: a link; where it is none, the root.
        """
        pin.framesForwardKinematics(self._model, self._data, self.configuration(positions))
        poses = {name: pin.SE3(self._data.oMf[index]) for name, index in self._links.items()}
        if planning_frame in poses and planning_frame != self.root:
            T_planning_root = poses[planning_frame].inverse()
            poses = {name: T_planning_root * T for name, T in poses.items()}
        return poses
