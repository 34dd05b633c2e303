"""examples/planning_scene.py, with messages as moveit_msgs has them, which the wheels lack."""

import importlib.util
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from geometry_msgs.msg import Point, Pose
from helpers.shared import ROOT
from shape_msgs.msg import Mesh, MeshTriangle, SolidPrimitive
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from placement_planner_ros.ros.inputs.known_objects import KnownObjects
from placement_planner_ros.ros.inputs.resources import Files

spec = importlib.util.spec_from_file_location("scene", ROOT / "examples" / "planning_scene.py")
example = importlib.util.module_from_spec(spec)
spec.loader.exec_module(example)


def collision_object(primitives=(), meshes=()):
    def at(z):
        return Pose(position=Point(z=z))

    return SimpleNamespace(
        id="thing",
        header=Header(frame_id="map"),
        pose=Pose(position=Point(x=1.0)),
        primitives=list(primitives),
        primitive_poses=[at(0.5) for _ in primitives],
        meshes=list(meshes),
        mesh_poses=[at(0.5) for _ in meshes],
    )


PYRAMID = Mesh(
    vertices=[Point(), Point(x=0.2), Point(y=0.2), Point(z=0.2)],
    triangles=[
        MeshTriangle(vertex_indices=corners)
        for corners in ([0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2])
    ],
)


@pytest.mark.parametrize(
    ("thing", "low", "high"),
    [
        (SolidPrimitive(type=1, dimensions=[0.2, 0.4, 0.6]), [0.9, -0.2, 0.2], [1.1, 0.2, 0.8]),
        (SolidPrimitive(type=2, dimensions=[0.1]), [0.9, -0.1, 0.4], [1.1, 0.1, 0.6]),
        (SolidPrimitive(type=3, dimensions=[0.6, 0.1]), [0.9, -0.1, 0.2], [1.1, 0.1, 0.8]),
        (SolidPrimitive(type=4, dimensions=[0.6, 0.1]), [0.9, -0.1, 0.2], [1.1, 0.1, 0.8]),
        (PYRAMID, [1.0, 0.0, 0.5], [1.2, 0.2, 0.7]),
    ],
    ids=["box", "sphere", "cylinder", "cone", "mesh"],
)
def test_what_moveit_knows_is_known_where_it_is(thing, low, high):
    solid = isinstance(thing, SolidPrimitive)
    told = collision_object([thing] if solid else [], [] if solid else [thing])
    known = KnownObjects(Files((), ()))
    assert not known.take(MarkerArray(markers=example.markers_of(told)))
    (surface,) = known.surfaces(lambda frame: pin.SE3.Identity())
    points = surface.within(np.full(3, -3.0), np.full(3, 3.0)).points
    assert np.allclose(points.min(axis=0), low, atol=0.002)
    assert np.allclose(points.max(axis=0), high, atol=0.002)
