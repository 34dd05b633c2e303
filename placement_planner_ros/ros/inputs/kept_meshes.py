"""Triangles of mesh files on disk, for the next process: read once for each content of a file."""

from __future__ import annotations

from pathlib import Path

from placement_planner_ros.core.disk_cache import find, keep
from placement_planner_ros.core.meshes.collada import Triangles
from placement_planner_ros.core.meshes.digest import content_digest
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.mesh_process import MeshProcess


def read_kept(process: MeshProcess, path: Path) -> tuple[Array, Triangles]:
    """Vertices (n, 3) and triangles (t, 3) of a file whose header was looked at.

    Starting the process takes a second of processor time, reading a large text some tenths: neither
    is needed where a file of that content was read before.

    Raises:
        OSError: it cannot be opened.
        ValueError: it cannot be read; the message says why.
        StoppedError: nobody wants it any more.
    """
    digest = content_digest(path.suffix.lower(), path.read_bytes())
    arrays: tuple[Array, Triangles] | None = find("read meshes", digest.hex())
    if arrays is None:
        vertices, triangles, digest = process.read_with_digest(path)  # it may have changed
        arrays = vertices, triangles
        keep("read meshes", digest.hex(), arrays)
    return arrays
