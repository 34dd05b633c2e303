"""A mesh over a topic is read from its bytes, however these are written."""

import numpy as np
import pytest
import trimesh
from geometry_msgs.msg import Point
from rclpy.serialization import serialize_message
from shape_msgs.msg import Mesh, MeshTriangle

from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.ros.inputs.mesh_message import mesh_from_message


def message(vertices, triangles):
    made = Mesh()
    made.vertices = [Point(x=x, y=y, z=z) for x, y, z in vertices]
    made.triangles = [MeshTriangle(vertex_indices=row) for row in triangles]
    return serialize_message(made)


def turned(data):
    """The same with the greatest byte of each number first."""
    triangles = int(np.frombuffer(data, "<u4", 1, 4)[0])
    at = 8 + 12 * triangles
    start = 4 + -(-at // 8) * 8
    whole = np.frombuffer(data[4 : at + 4], "<u4").astype(">u4").tobytes()
    points = np.frombuffer(data[start:], "<f8").astype(">f8").tobytes()
    return b"\0\0\0\0" + whole + data[at + 4 : start] + points


@pytest.mark.parametrize("removed", [0, 1])
@pytest.mark.parametrize("order", [lambda data: data, turned])
def test_it_holds_what_was_given(removed, order):
    ball = trimesh.creation.icosphere(1)
    faces = ball.faces[removed:]  # numbers of 8 bytes come at once, or after a gap
    vertices, triangles = mesh_from_message(order(message(ball.vertices, faces)))
    assert np.array_equal(vertices, ball.vertices)
    assert np.array_equal(triangles, faces)
    assert vertices.dtype == np.float64
    assert triangles.dtype == np.int64
    vertices[0] = 1.0  # their own


@pytest.mark.parametrize(
    ("vertices", "triangles", "said"),
    [
        ([], [], "has no triangle"),
        ([[0.0, 0.0, 0.0]], [], "has no triangle"),
        ([], [[0, 1, 2]], "only 0 vertices"),
        ([[0.0, 0.0, 0.0]] * 2, [[0, 1, 2]], "only 2 vertices"),
        ([[0.0, 0.0, 0.0]], [[0, 0, 0]] * 300_001, "may have 300000"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices, triangles, said):
    if len(triangles) < 10:
        data = message(vertices, triangles)
    else:
        data = b"\0\1\0\0" + np.array([len(triangles), *np.ravel(triangles), 0], "<u4").tobytes()
    with pytest.raises(ObjectError, match=said):
        mesh_from_message(data)


def test_bytes_that_end_early_are_refused():
    ball = trimesh.creation.icosphere(0)
    data = message(ball.vertices, ball.faces)
    for end in range(4, len(data) - 8, 7):
        with pytest.raises(ObjectError, match="end before the mesh does"):
            mesh_from_message(data[:end])
