"""A picture of a robot as the planner has it: at the start, and in each grasp."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.pictures.animation import side_by_side, titled_frame
from placement_planner_ros.pictures.rendering import Image, Mesh, camera_around, render
from placement_planner_ros.pictures.shapes import PLACED, RobotShapes, moved, tube, volume_edges

_TOWARDS_EYE = (-0.9, 0.45)
"""Azimuth and elevation, rad."""
_PANEL = (520, 420)
"""Pixels."""


def draw_robot(
    path: Path, robot: Robot, q: Array, arms: Sequence[Arm], body: Body, volume: TargetVolume
) -> None:
    """Write a PNG: the robot at q (nq,) with V and, with the hand open, each grasp."""
    shapes = RobotShapes(robot, [link for arm in arms for link in arm.touch_links])
    shown, panels = [*shapes.at(q), *volume_edges(volume)], []
    # each arm with the object in its first grasp
    for arm in arms:
        T_world_tip = robot.link_pose(q, arm.tip_frame)
        shown += _axes_at(T_world_tip)
        if arm.grasps:
            shown.append(_held(body, T_world_tip * arm.grasps[0]))
    panels.append(("at the start, first grasps, tip axes x y z in red, green, blue", shown))

    grasps = [(arm, number) for arm in arms for number in range(len(arm.grasps))]
    for arm, number in grasps:
        opened = robot.with_open_hand(q, arm) if arm.gripper_joints else q
        T_world_tip = robot.link_pose(opened, arm.tip_frame)
        # of each grasp the hand alone, opened as for letting go
        hand = [
            mesh
            for mesh, link in zip(shapes.at(opened), robot.geometry_links, strict=True)
            if link in arm.touch_links
        ]
        held = _held(body, T_world_tip * arm.grasps[number])
        panels.append((f"{arm.name}, grasp {number}", [*hand, held, *_axes_at(T_world_tip)]))
    frames = [titled_frame(_drawn(meshes), words) for words, meshes in panels]
    side_by_side(frames, 3).save(path, format="PNG")


def _drawn(meshes: Sequence[Mesh]) -> Image:
    points = np.vstack([mesh.corners.reshape(-1, 3) for mesh in meshes])
    return render(camera_around(points, _TOWARDS_EYE, (2 * _PANEL[0], 2 * _PANEL[1])), meshes)


def _held(body: Body, T: pin.SE3) -> Mesh:
    return Mesh(moved(body.vertices[body.triangles], T), PLACED)


def _axes_at(T: pin.SE3) -> list[Mesh]:
    """x, y and z of a frame in red, green and blue, 10 cm long."""
    ends = [np.array([T.translation, T.translation + 0.1 * axis]) for axis in T.rotation.T]
    return [tube(ends[k], tuple(np.eye(3)[k] * 0.85)) for k in range(3)]
