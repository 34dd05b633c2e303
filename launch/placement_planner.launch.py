"""The node, with a parameter file: `params_file:=...`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    default = PathJoinSubstitution(
        [FindPackageShare("placement_planner_ros"), "config", "small_crayons_box.yaml"]
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=default),
            Node(
                package="placement_planner_ros",
                executable="placement_planner",
                output="screen",
                parameters=[LaunchConfiguration("params_file")],
            ),
        ]
    )
