"""A mesh as it comes over a topic, taken from its bytes, or by parameters.

rclpy makes an object of Python for each vertex and triangle: 2 s of processor time for 200,000
triangles, in the thread that hands out all callbacks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from placement_planner_ros.core.body.mesh import require_few
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array, Index

Triangles = Index

_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}
"""Plain CDR by its first bytes; after four, numbers lie on multiples of their size."""


def mesh_from_message(data: bytes) -> tuple[Array, Triangles]:
    """Vertices (n, 3) and triangles (t, 3) of a serialised `shape_msgs/Mesh`.

    Raises:
        ObjectError: there are none, too many, or indices of vertices that are not there, or the
            bytes end early or are of another encoding.
    """
    order = _ORDERS.get(data[:2])
    if order is None:
        raise ObjectError("~/object", f"encoding {data[:2].hex()}", "is not read; use plain CDR")
    try:
        vertices, triangles = _plain(data[4:], order)
    except ValueError as error:  # numpy's, of what lies beyond the end
        remedy = "end before the mesh does; publish a shape_msgs/Mesh"
        raise ObjectError("~/object", f"{len(data)} bytes", remedy) from error
    if len(triangles) == 0:
        raise ObjectError("~/object", f"{len(vertices)} vertices", "has no triangle")
    _require_indices("~/object", vertices, triangles)
    return vertices, triangles


def mesh_from_lists(vertices: Sequence[float], triangles: Sequence[int]) -> tuple[Array, Triangles]:
    """The same of the parameters object.vertices and object.triangles.

    Raises:
        ObjectError: as above.
    """
    for name, values in (("object.vertices", vertices), ("object.triangles", triangles)):
        if not values or len(values) % 3 != 0:
            raise ObjectError(name, f"{len(values)} numbers", "give three for each, at least one")
    require_few(len(vertices) // 3, len(triangles) // 3)
    points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    faces = np.array(triangles, dtype=np.int64).reshape(-1, 3)
    _require_indices("object.triangles", points, faces)
    return points, faces


def _require_indices(field: str, vertices: Array, triangles: Triangles) -> None:
    if triangles.max() >= len(vertices):
        raise ObjectError(field, int(triangles.max()), f"there are only {len(vertices)} vertices")


def _plain(data: bytes, order: str) -> tuple[Array, Triangles]:
    """Of plain CDR: each sequence after its length."""
    count = np.dtype(f"{order}u4")
    triangles = int(np.frombuffer(data, count, 1)[0])
    # triangles come first, three indices each, then the number of vertices
    at = count.itemsize * (1 + 3 * triangles)
    vertices = int(np.frombuffer(data, count, 1, at)[0])
    # before anything of that size is made
    require_few(vertices, triangles)
    corners = np.frombuffer(data, count, 3 * triangles, count.itemsize)
    # doubles begin at the next multiple of 8
    at = -(-(at + count.itemsize) // 8) * 8
    points = np.frombuffer(data, f"{order}f8", 3 * vertices, at if vertices else 0)
    return (points.astype(np.float64).reshape(-1, 3), corners.astype(np.int64).reshape(-1, 3))
