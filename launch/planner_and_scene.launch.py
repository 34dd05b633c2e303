"""The node before a bundled scene, told what it needs of scene and object.

Then: `ros2 service call /placement_planner/start std_srvs/srv/Trigger`.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, LogInfo, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

PACKAGE = "placement_planner_ros"
START = "ros2 service call /placement_planner/start std_srvs/srv/Trigger"


def generate_launch_description():
    share = Path(get_package_share_directory(PACKAGE))
    scene = PythonLaunchDescriptionSource(str(share / "launch" / "placement_scene.launch.py"))
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file",
                default_value="",
                description="Parameter file for the node besides those of scene and object; what "
                "it says counts. None by default.",
            ),
            IncludeLaunchDescription(scene),
            OpaqueFunction(function=_planner),
            LogInfo(msg=f"to begin: {START}"),
        ]
    )


def _planner(context):
    """The node with the files of config/ that fit the scene."""
    scene, held, clouds, more = (
        LaunchConfiguration(name).perform(context)
        for name in ("scene", "object", "clouds", "params_file")
    )
    config = Path(get_package_share_directory(PACKAGE)) / "config"
    place = "cabinet" if scene.startswith("cabinet") else scene
    files = [config / f"{held}.yaml"]
    if place != "cabinet":
        files.append(config / f"{place}.yaml")
    if clouds == "cameras":
        files.append(config / f"{place}_cameras.yaml")
    if more:
        files.append(Path(more))
    return [
        Node(
            package=PACKAGE,
            executable="placement_planner",
            output="screen",
            parameters=[str(file) for file in files],
        )
    ]
