"""The robot that practises: a gantry with a wrist and a hand, joints and shapes of every kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from placement_planner_ros.core.body.mesh import Triangles
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array

_LINKS = {
    "base": ('<box size="0.2 0.2 0.4"/>', "-0.8 0 0.2"),
    "beam": None,
    "bridge": None,
    "column": ('<cylinder radius="0.03" length="0.2"/>', "0 0 1.1"),
    "wrist_1": ('<sphere radius="0.03"/>', "0 0 0.35"),
    "wrist_2": ('<mesh filename="bracket"/>', "0 0 0.24"),
    "wrist_3": ('<sphere radius="0.02"/>', "0 0 0.1"),
    "hand": ('<box size="0.14 0.05 0.03"/>', "0 0 0.02"),
    "left": ('<box size="0.01 0.03 0.08"/>', "0.005 0 -0.04"),
    "right": ('<box size="0.01 0.03 0.08"/>', "-0.005 0 -0.04"),
}
"""Link -> its shape and where that is, metres."""

_JOINTS = (
    ("slide", "prismatic", "base", "beam", "1 0 0", (-0.2, 0.2)),
    ("across", "prismatic", "beam", "bridge", "0 1 0", (-0.5, 0.5)),
    ("along", "prismatic", "bridge", "column", "1 0 0", (-0.5, 0.5)),
    ("lift", "prismatic", "column", "wrist_1", "0 0 1", (0.0, 0.5)),
    ("turn", "continuous", "wrist_1", "wrist_2", "0 0 1", None),
    ("tilt", "revolute", "wrist_2", "wrist_3", "0 1 0", (-0.6, 0.6)),
    ("lean", "revolute", "wrist_3", "hand", "1 0 0", (-0.6, 0.6)),
    ("finger_1", "prismatic", "hand", "left", "1 0 0", (0.0, 0.065)),
    ("finger_2", "prismatic", "hand", "right", "-1 0 0", (0.0, 0.065)),
)
"""Name, kind, parent, child, axis, limits in rad or m."""

_MIMICS = {"finger_2": "finger_1"}

START = {"finger_1": 0.03, "lift": 0.45}
"""Where it stands, an object 0.06 m wide between its fingers; all other joints at zero."""


def known_robot() -> tuple[Robot, Arm]:
    """The robot, and its arm with one grasp: from above, of what is 0.06 m wide."""
    # The hand is above what it holds.
    robot = Robot.from_urdf(_urdf_text(), _Bracket())
    grasp = np.eye(4)
    grasp[2, 3] = -0.09
    arm = robot.arm(
        "arm", "hand", grasps=[grasp], gripper_joints=("finger_1",), gripper_open=(0.06,)
    )
    return robot, arm


def _urdf_text() -> str:
    links = [_link_element(name, given) for name, given in _LINKS.items()]
    return "\n".join(
        ['<robot name="known">', *links, *(_joint_element(*j) for j in _JOINTS), "</robot>"]
    )


def _link_element(name: str, given: tuple[str, str] | None) -> str:
    if given is None:
        return f'<link name="{name}"/>'
    shape, place = given
    geometry = f'<origin xyz="{place}"/><geometry>{shape}</geometry>'
    return f'<link name="{name}"><collision>{geometry}</collision></link>'


def _joint_element(
    name: str, kind: str, parent: str, child: str, axis: str, limits: tuple[float, float] | None
) -> str:
    within = f'lower="{limits[0]}" upper="{limits[1]}" ' if limits else ""
    mimic = f'<mimic joint="{_MIMICS[name]}"/>' if name in _MIMICS else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{axis}"/><limit {within}velocity="1" effort="1"/>{mimic}</joint>'
    )


class _Bracket:
    """The one mesh of the robot, a solid angle, instead of files."""

    def find(self, uri: str) -> Path:
        """Any name does."""
        return Path(uri)

    def read(self, path: Path) -> tuple[Array, Triangles]:
        """Vertices and triangles."""
        # An L, drawn out along z.
        corners = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 3], [0, 3]]) * 0.02
        ends = (np.full(6, -0.02), np.full(6, 0.02))
        vertices = np.vstack([np.column_stack([corners, end]) for end in ends])
        # Both ends, then the sides.
        cap = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
        faces = [*cap[:, ::-1], *(cap + 6)]
        for k in range(6):
            a, b = k, (k + 1) % 6
            faces += [[a, b, b + 6], [a, b + 6, a + 6]]
        return vertices, np.array(faces, dtype=np.int64)
