"""Has the node plan among things whose meshes and places are known, without a camera.

    python examples/known_scene.py --frame yumi_body shelf.stl tin.obj

The meshes' coordinates are those of the frame, in metres. Without files it is a table with two
boxes. The surfaces are published as points, denser than `cloud.cell_size`; `~/known_objects` takes
meshes as they are.
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

from placement_planner_ros.ros.inputs.point_cloud import message_from_points

SPACING = 0.005
"""m between points at most; half a cell."""


def table_with_boxes() -> list[trimesh.Trimesh]:
    """Something to try, in front of the bundled robot."""
    bounds = [
        [[0.15, -0.45, -0.30], [0.70, 0.45, 0.00]],
        [[0.45, -0.15, 0.00], [0.53, -0.05, 0.12]],
        [[0.40, 0.15, 0.00], [0.60, 0.20, 0.06]],
    ]
    return [trimesh.creation.box(bounds=each) for each in bounds]


def surface_points(meshes: Sequence[trimesh.Trimesh]) -> npt.NDArray[np.float64]:
    """(n, 3) points on the surfaces, m, the same at every call; corners and edges among them."""
    dense = [
        trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, SPACING, max_iter=20)[0]
        for mesh in meshes
    ]
    return np.vstack(dense)


class KnownScene(Node):
    """The points of the scene again and again."""

    def __init__(self, meshes: Sequence[trimesh.Trimesh], frame: str) -> None:
        super().__init__("known_scene")
        points = surface_points(meshes)
        self._message = message_from_points(points, Header(frame_id=frame))
        self._points = self.create_publisher(PointCloud2, "points", 1)
        self.create_timer(0.5, self._publish)
        self.get_logger().info(f"{len(meshes)} meshes as {len(points)} points in {frame}")

    def _publish(self) -> None:
        self._message.header.stamp = self.get_clock().now().to_msg()
        self._points.publish(self._message)


def main(arguments: Sequence[str] | None = None) -> None:
    """Publish until interrupted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("meshes", type=Path, nargs="*")
    parser.add_argument("--frame", default="yumi_body", help="that the meshes' coordinates are in")
    options = parser.parse_args(arguments)
    meshes = [trimesh.load_mesh(file) for file in options.meshes] or table_with_boxes()
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(KnownScene(meshes, options.frame))


if __name__ == "__main__":
    main()
