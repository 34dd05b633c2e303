"""The node. `ros2 launch placement_planner_ros placement_planner.launch.py params_file:=...`"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "placement_planner_ros"


def generate_launch_description():
    default = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "small_crayons_box.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file",
                default_value=default,
                description="Parameter file of the node: robot, object, grasps, target volume; see "
                "docs/parameters.md. The default: the bundled robot holds a small box.",
            ),
            DeclareLaunchArgument(
                "log_level",
                default_value="info",
                choices=["debug", "info", "warn", "error", "fatal"],
                description="What the node says at least.",
            ),
            Node(
                package=PACKAGE,
                executable="placement_planner",
                output="screen",
                parameters=[LaunchConfiguration("params_file")],
                arguments=["--ros-args", "--log-level", LaunchConfiguration("log_level")],
            ),
        ]
    )
