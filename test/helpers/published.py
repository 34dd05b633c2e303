"""What the node publishes about the bundled YuMi, as the checker reads it."""

import numpy as np
import pinocchio as pin
from checker import Solution
from helpers.tasks import yumi_task

from placement_planner_ros.core.types import Trajectory
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.primitives import ConvexPrimitive
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import TIP_FRAMES, load_yumi, yumi_arm


def curve_of(message):
    """A trajectory message as the checker reads it, times as they were published."""
    columns = zip(
        *(
            (
                p.time_from_start.sec + p.time_from_start.nanosec * 1e-9,
                p.positions,
                p.velocities,
                p.accelerations,
            )
            for p in message.points
        ),
        strict=True,
    )
    return Trajectory(tuple(message.joint_names), *(np.array(column) for column in columns))


def pose_of(message):
    """T_world_object of a stamped pose."""
    p, r = message.pose.position, message.pose.orientation
    return pin.XYZQUATToSE3(np.array([p.x, p.y, p.z, r.x, r.y, r.z, r.w]))


def task_of(scene, thing, objective="maximize_clearance", placed=()):
    """What was asked of a run in a bundled scene with a bundled object.

    Args:
        placed: poses at which such an object stands already.
    """
    held, world = object_by_name(thing), scene_by_name(scene)
    standing = [
        ConvexPrimitive(part.name, part.vertices @ other.rotation.T + other.translation)
        for other in placed
        for part in held.parts
    ]
    # beyond is as the node has it unless told otherwise
    return yumi_task(world, held, objective, solids=[*world.parts, *standing], beyond=0.5)


def solution_of(thing, manifest, trajectory, retreat, pose):
    """A solution by the values of its manifest and by its parts."""
    arm = yumi_arm(load_yumi(), manifest["arm"])
    grasps = object_by_name(thing).grasps[manifest["arm"]]
    return Solution(
        trajectory=curve_of(trajectory),
        approach_start=float(manifest["approach_start"]),
        placement_pose=pose_of(pose).homogeneous,
        objective=float(manifest["objective"]),
        tip_frame=TIP_FRAMES[manifest["arm"]],
        T_tip_object=grasps[int(manifest["grasp"])].homogeneous,
        touch_links=arm.touch_links,
        retreat=curve_of(retreat),
        gripper_open=dict(zip(arm.gripper_joints, arm.gripper_open, strict=True)),
    )
