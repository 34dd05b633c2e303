"""Publishes a cloud from a file as a depth camera would.

    python examples/camera.py scan.ply --frame camera_optical_frame

Files: .ply, .xyz, .csv or .npy, points in metres; columns and fields after x, y, z do not count
(pcl_pcd2ply makes a .ply of a .pcd). Where the frame is no link of the robot and tf2
does not know it, tell the node where it is: `sensor_frames: [camera_optical_frame]` and
`sensor_poses.camera_optical_frame: [x, y, z, qx, qy, qz, qw]`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import numpy.typing as npt
import rclpy
import trimesh
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.ros.inputs.point_cloud import message_from_points


def read_points(file: Path) -> npt.NDArray[np.float64]:
    """(n, 3) points of a file, m.

    Raises:
        PlacementPlannerError, ValueError: there are none in it, or they cannot be read.
    """
    kind = file.suffix.lower()
    if kind == ".npy":
        array = np.load(file)
        return np.asarray(array.reshape(-1, array.shape[-1])[:, :3], dtype=np.float64)
    if kind == ".csv":
        return np.loadtxt(file, delimiter=",", usecols=(0, 1, 2), ndmin=2)
    try:
        read = trimesh.load(file)
    except NotImplementedError:  # of the file's kind
        read = None
    if not isinstance(read, trimesh.PointCloud | trimesh.Trimesh):
        raise ValueError(f"{file} has no points; write it as .ply, .xyz, .csv or .npy")
    return np.asarray(read.vertices, dtype=np.float64)


class FileCamera(Node):
    """The same cloud again and again, each time with the time of now."""

    def __init__(self, points: npt.NDArray[np.float64], name: str, frame: str, rate: float) -> None:
        super().__init__("file_camera")
        self._message = message_from_points(points, Header(frame_id=frame))
        self._points = self.create_publisher(PointCloud2, "points", 1)
        self.create_timer(1.0 / rate, self._publish)
        self.get_logger().info(f"{len(points)} points of {name} in {frame}")

    def _publish(self) -> None:
        self._message.header.stamp = self.get_clock().now().to_msg()
        self._points.publish(self._message)


def main(arguments: Sequence[str] | None = None) -> None:
    """Publish until interrupted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--frame", required=True, help="in which the points are")
    parser.add_argument("--rate", type=float, default=2.0, help="clouds per second")
    options = parser.parse_args(arguments)
    try:
        points = read_points(options.file)
    except (OSError, ValueError, PlacementPlannerError) as error:
        parser.error(str(error))
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(FileCamera(points, options.file.name, options.frame, options.rate))


if __name__ == "__main__":
    main()
