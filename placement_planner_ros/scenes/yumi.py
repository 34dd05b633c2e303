"""The bundled robot: a dual-arm ABB YuMi, its arms and the configurations it is used in."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

import pinocchio as pin

from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.scenes.objects import GraspedObject, object_by_name
from placement_planner_ros.share import PACKAGE, share_path

TIP_FRAMES: Mapping[str, str] = MappingProxyType(
    {"left": "gripper_l_base", "right": "gripper_r_base"}
)
"""Arm name -> link that grasps refer to; the fingers close along its x and point along its z."""

GRIPPER_JOINTS: Mapping[str, str] = MappingProxyType(
    {"left": "gripper_l_joint", "right": "gripper_r_joint"}
)

GRIPPER_OPEN = 0.025
"""m, travel of one finger from closed to open; the opening is twice that."""

START_CONFIGURATION: Mapping[str, float] = MappingProxyType(
    dict.fromkeys((f"yumi_joint_{n}_{side}" for side in "lr" for n in range(1, 8)), 0.0)
    | {"yumi_joint_1_l": -0.93, "yumi_joint_2_l": -1.55}
    | {"yumi_joint_1_r": 0.69, "yumi_joint_2_r": -1.95}
    | dict.fromkeys(GRIPPER_JOINTS.values(), 0.02)
)
"""Where the paper's experiments start, the fingers 40 mm apart. Joint name -> rad or m."""


def start_configuration(held: str | GraspedObject, arm: str | None = None) -> dict[str, float]:
    """q_0 of the experiments with the fingers closed on the object, in one hand or in both.

    Args:
        held: the object, or the name of a bundled one.
        arm: the arm that holds the object; None leaves it open and closes both hands on it.
    """
    positions = dict(START_CONFIGURATION)
    opening = (object_by_name(held) if isinstance(held, str) else held).finger_opening
    for name, joint in GRIPPER_JOINTS.items():
        if arm in (None, name):
            positions[joint] = opening
    return positions


def load_yumi() -> Robot:
    """The YuMi from the URDF and SRDF of this package.

    Raises:
        FileNotFoundError: the package is not fully installed.
    """
    urdf = share_path("urdf", "yumi.urdf")
    srdf = share_path("urdf", "yumi.srdf")
    return Robot.from_urdf(
        urdf.read_text(encoding="utf-8"),
        package_dirs={PACKAGE: urdf.parent.parent},
        srdf=srdf.read_text(encoding="utf-8"),
    )


def yumi_arm(robot: Robot, name: str, grasps: Iterable[pin.SE3] = ()) -> Arm:
    """Arm `left` or `right` of `load_yumi()`, holding the object in any of `grasps` (T_tip_object).

    Raises:
        KeyError: no such arm.
    """
    return robot.arm(
        name,
        tip_frame=TIP_FRAMES[name],
        grasps=grasps,
        gripper_joints=(GRIPPER_JOINTS[name],),
        gripper_open=(GRIPPER_OPEN,),
    )
