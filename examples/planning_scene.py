"""MoveIt's planning scene as known objects of the planner.

    python examples/planning_scene.py --ros-args -p node:=placement_planner

Listens to `monitored_planning_scene` and publishes what is in its world: boxes, spheres, cylinders,
cones and meshes as markers in `<node>/known_objects`. Needs moveit_msgs, which Jazzy has.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import rclpy
import trimesh
from geometry_msgs.msg import Point, Pose, Vector3
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from shape_msgs.msg import SolidPrimitive
from visualization_msgs.msg import Marker, MarkerArray

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def se3(pose: Pose) -> pin.SE3:
    """A pose as a transform."""
    p, r = pose.position, pose.orientation
    return pin.XYZQUATToSE3(np.array([p.x, p.y, p.z, r.x, r.y, r.z, r.w]))


def marker_of_primitive(shape: SolidPrimitive) -> Marker:
    """A box, sphere, cylinder or cone."""
    size = list(shape.dimensions)
    if shape.type == SolidPrimitive.BOX:
        return Marker(type=Marker.CUBE, scale=Vector3(x=size[0], y=size[1], z=size[2]))
    if shape.type == SolidPrimitive.SPHERE:
        width = 2.0 * size[0]
        return Marker(type=Marker.SPHERE, scale=Vector3(x=width, y=width, z=width))
    height, width = size[0], 2.0 * size[1]
    if shape.type == SolidPrimitive.CYLINDER:
        return Marker(type=Marker.CYLINDER, scale=Vector3(x=width, y=width, z=height))
    cone = trimesh.creation.cone(width / 2.0, height)  # MoveIt's has its origin half-way up
    return marker_of_triangles(cone.triangles - (0.0, 0.0, height / 2.0))


def marker_of_triangles(corners: np.ndarray) -> Marker:
    """Triangles (t, 3, 3), metres."""
    points = [Point(x=x, y=y, z=z) for x, y, z in corners.reshape(-1, 3).tolist()]
    return Marker(type=Marker.TRIANGLE_LIST, scale=Vector3(x=1.0, y=1.0, z=1.0), points=points)


def markers_of(thing: Any) -> list[Marker]:
    """A moveit_msgs/CollisionObject as markers."""
    parts = [
        *zip(map(marker_of_primitive, thing.primitives), thing.primitive_poses, strict=True),
        *zip(map(marker_of_mesh, thing.meshes), thing.mesh_poses, strict=True),
    ]
    for number, (marker, pose) in enumerate(parts):
        x, y, z, *turn = pin.SE3ToXYZQUAT(se3(thing.pose) * se3(pose)).tolist()
        marker.header, marker.ns, marker.id = thing.header, thing.id, number
        at, r = marker.pose.position, marker.pose.orientation
        at.x, at.y, at.z = x, y, z
        r.x, r.y, r.z, r.w = turn
    return [marker for marker, _ in parts]


def marker_of_mesh(mesh: Any) -> Marker:
    """A shape_msgs/Mesh."""
    vertices = np.array([[p.x, p.y, p.z] for p in mesh.vertices])
    triangles = np.array([t.vertex_indices for t in mesh.triangles], dtype=np.int64)
    return marker_of_triangles(vertices[triangles])


class PlanningScene(Node):
    """Publishes the world of each planning scene that comes.

    Args:
        kind: moveit_msgs' PlanningScene.
    """

    def __init__(self, kind: type) -> None:
        super().__init__("planning_scene_to_known_objects")
        node = self.declare_parameter("node", "placement_planner").value
        self._known: dict[str, list[Marker]] = {}
        self._out = self.create_publisher(MarkerArray, f"{node}/known_objects", LATCHED)
        self.create_subscription(kind, "monitored_planning_scene", self._take, 10)

    def _take(self, scene: Any) -> None:
        before = dict(self._known)
        if not scene.is_diff:
            self._known = {}
        for thing in scene.world.collision_objects:
            if thing.operation == type(thing).ADD:
                self._known[thing.id] = markers_of(thing)
            elif thing.operation == type(thing).REMOVE:
                self._known.pop(thing.id, None)
        # all of it each time, so that who comes later knows it from the last message alone
        markers = [Marker(ns=name, action=Marker.DELETEALL) for name in {*before, *self._known}]
        markers += [marker for each in self._known.values() for marker in each]
        if markers:
            self._out.publish(MarkerArray(markers=markers))


def main() -> None:
    """Run until interrupted."""
    try:
        from moveit_msgs.msg import PlanningScene as Scene
    except ImportError as error:
        raise SystemExit("moveit_msgs is missing: apt install ros-jazzy-moveit-msgs") from error
    rclpy.init()
    rclpy.spin(PlanningScene(Scene))


if __name__ == "__main__":
    main()
