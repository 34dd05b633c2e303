"""Where can the YuMi put down the box in its left hand? The planner as a library, without ROS."""

import numpy as np
import pinocchio as pin
import trimesh

from placement_planner_ros import Body, Robot, TargetVolume, plan
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import START_CONFIGURATION
from placement_planner_ros.share import share_path

urdf, srdf = share_path("urdf", "yumi.urdf"), share_path("urdf", "yumi.srdf")
meshes = {"placement_planner_ros": urdf.parent.parent}  # where package:// URIs lead
robot = Robot.from_urdf(urdf.read_text(), meshes, srdf.read_text())
grasp = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.145]))  # pose of the box in the tip's frame
arm = robot.arm(
    "left",
    tip_frame="gripper_l_base",
    grasps=[grasp],
    gripper_joints=["gripper_l_joint"],
    gripper_open=[0.025],  # metres
)
start = {**START_CONFIGURATION, "gripper_l_joint": 0.0105}  # joint values by name: rad, m
box = trimesh.creation.box((0.021, 0.071, 0.094))  # metres; or trimesh.load("my_object.stl")
body = Body.from_mesh(box.vertices, box.faces)
points = complete_cloud(scene_by_name("cabinet_high_clutter"))  # (n, 3), from your camera
volume = TargetVolume(np.array([0.33, -0.53, 0.15]), np.array([0.75, 0.40, 0.44]))

for placement in plan(robot, arm, start, body, volume, points, time_limit=10.0, seed=1):
    position, motion = placement.T_world_object.translation.round(3), placement.trajectory
    print(f"at {position}: objective {placement.objective:.4f}, motion of {motion.duration:.1f} s")
