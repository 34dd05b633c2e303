"""The node before a bundled scene, and RViz with all that both publish.

RViz draws the robot where tf says its links are, so robot_state_publisher is started, too.
"""

from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

PACKAGE = "placement_planner_ros"
BASE = "yumi_body"


def generate_launch_description():
    share = Path(get_package_share_directory(PACKAGE))
    both = PythonLaunchDescriptionSource(str(share / "launch" / "planner_and_scene.launch.py"))
    urdf = (share / "urdf" / "yumi.urdf").read_text(encoding="utf-8")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "rviz_config",
                default_value=str(share / "config" / "placement_planner.rviz"),
                description="What RViz shows. The default shows all that node and scene publish.",
            ),
            IncludeLaunchDescription(both),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[{"robot_description": ParameterValue(urdf, value_type=str)}],
                # the scene publishes the description already
                remappings=[("robot_description", "robot_state_publisher/robot_description")],
            ),
            OpaqueFunction(function=_cameras),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", LaunchConfiguration("rviz_config")],
            ),
        ]
    )


def _cameras(context):
    """Where the cameras are, for RViz; the node has it from its parameters."""
    if LaunchConfiguration("clouds").perform(context) != "cameras":
        return []
    place = "table" if LaunchConfiguration("scene").perform(context) == "table" else "cabinet"
    file = Path(get_package_share_directory(PACKAGE)) / "config" / f"{place}_cameras.yaml"
    parameters = yaml.safe_load(file.read_text(encoding="utf-8"))["/**"]["ros__parameters"]
    return [
        Node(
            package="tf2_ros",
            executable="static_transform_publisher",
            name=f"{frame}_publisher",
            arguments=_as_arguments(pose, frame),
        )
        for frame, pose in parameters["sensor_poses"].items()
    ]


def _as_arguments(pose, frame):
    named = zip(("x", "y", "z", "qx", "qy", "qz", "qw"), pose, strict=True)
    numbers = [word for name, value in named for word in (f"--{name}", str(value))]
    return [*numbers, "--frame-id", BASE, "--child-frame-id", frame]
