"""A mesh as it comes over a topic, taken from its bytes.

rclpy makes an object of Python for each vertex and triangle: 2 s of processor time for 200,000
triangles, in the thread that hands out all callbacks.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.mesh import require_few
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array

Triangles = npt.NDArray[np.int64]

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
    count = len(vertices)
    if len(triangles) == 0:
        raise ObjectError("~/object", f"{count} vertices", "has no triangle")
    if triangles.max() >= count:
        raise ObjectError("~/object", int(triangles.max()), f"there are only {count} vertices")
    return vertices, triangles


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
    return (
        points.astype(np.float64).reshape(-1, 3),
        corners.astype(np.int64).reshape(-1, 3),
    )
