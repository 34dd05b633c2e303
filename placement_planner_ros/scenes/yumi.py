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

GRIPPER_HOLDING = 0.02
"""m, travel of one finger in the configurations below: an opening of 40 mm."""

_ARM_JOINTS = (1, 2, 7, 3, 4, 5, 6)


def _joint_values(left: Iterable[float], right: Iterable[float]) -> Mapping[str, float]:
    # joint numbers as ABB counts them along the arm
    values = {"gripper_l_joint": GRIPPER_HOLDING, "gripper_r_joint": GRIPPER_HOLDING}
    for side, angles in (("l", left), ("r", right)):
        values |= {
            f"yumi_joint_{n}_{side}": float(angle)
            for n, angle in zip(_ARM_JOINTS, angles, strict=True)
        }
    return MappingProxyType(values)


HOME = _joint_values(
    left=(0.0, -2.268928, 2.356194, 0.523599, 0.0, 0.698132, 0.0),
    right=(0.0, -2.268928, -2.356194, 0.523599, 0.0, 0.698132, 0.0),
)
"""ABB's home position: 0, -130, ±135, 30, 0, 40, 0 degrees. Joint name -> rad or m."""

START_CONFIGURATION = _joint_values(
    left=(-0.93, -1.55, 0.0, 0.0, 0.0, 0.0, 0.0),
    right=(0.69, -1.95, 0.0, 0.0, 0.0, 0.0, 0.0),
)
"""Where the paper's experiments start. Joint name -> rad or m."""


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
