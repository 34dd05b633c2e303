"""A bundled scene: its clouds, and the joint states and the description of the bundled robot."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "scene",
                default_value="cabinet_high_clutter",
                choices=["cabinet_low_clutter", "cabinet_high_clutter", "table", "shelf"],
                description="What stands before the robot.",
            ),
            DeclareLaunchArgument(
                "object",
                default_value="small_crayons_box",
                choices=[
                    "large_crayons_box",
                    "small_crayons_box",
                    "wine_glass",
                    "toy_table",
                    "book",
                ],
                description="What the fingers are closed around in the joint states.",
            ),
            DeclareLaunchArgument(
                "clouds",
                default_value="complete",
                choices=["complete", "cameras"],
                description="complete: the whole surface on 'points', in the robot's frame; "
                "cameras: what two depth cameras see, on 'camera_left/points' and "
                "'camera_right/points'.",
            ),
            DeclareLaunchArgument(
                "rate", default_value="2.0", description="Clouds a second, up to 100."
            ),
            Node(
                package="placement_planner_ros",
                executable="placement_scene",
                output="screen",
                parameters=[
                    {
                        "name": LaunchConfiguration("scene"),
                        "object": LaunchConfiguration("object"),
                        "clouds": LaunchConfiguration("clouds"),
                        "rate": ParameterValue(LaunchConfiguration("rate"), value_type=float),
                    }
                ],
            ),
        ]
    )
