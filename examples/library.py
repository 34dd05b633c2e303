"""Where can the YuMi put down the box in its left hand? The planner as a library, without ROS."""

import numpy as np
import pinocchio as pin
import trimesh

from placement_planner_ros import Body, TargetVolume, plan
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi

robot = load_yumi()  # or your own: Robot.from_urdf(urdf_text, {"package": folder}, srdf_text)
grasp = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.145]))  # pose of the box in the tip's frame
fingers, opened = ["gripper_l_joint"], [0.025]  # metres
arm = robot.arm(
    "left", "gripper_l_base", grasps=[grasp], gripper_joints=fingers, gripper_open=opened
)
start = {**START_CONFIGURATION, "gripper_l_joint": 0.0105}  # joint values by name: rad, m
box = trimesh.creation.box((0.021, 0.071, 0.094))  # metres; or trimesh.load("my_object.stl")
body = Body.from_mesh(box.vertices, box.faces)
points = complete_cloud(scene_by_name("cabinet_high_clutter"))  # (n, 3), from your camera
volume = TargetVolume(np.array([0.33, -0.53, 0.15]), np.array([0.75, 0.40, 0.44]))

for placement in plan(robot, arm, start, body, volume, points, time_limit=5.0, seed=1):
    position, motion = placement.T_world_object.translation.round(3), placement.trajectory
    print(f"at {position}: objective {placement.objective:.4f}, motion of {motion.duration:.1f} s")
