"""Meshes and convex covers from disk, or read and made in another process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from placement_planner_ros.core.body.convex_cover import Cover, hull_cover
from placement_planner_ros.core.body.covered_mesh import kept_cover
from placement_planner_ros.core.disk_cache import find, keep
from placement_planner_ros.core.meshes.read import Triangles, content_digest
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.mesh_process import (
    MAX_TIME,
    MeshProcess,
    ProcessorTimeError,
)


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


def cover_in(
    process: MeshProcess,
    vertices: Array,
    triangles: Triangles,
    tolerance: float,
    began: Callable[[], None] = lambda: None,
    seconds: float = MAX_TIME,
    failed: Callable[[], None] = lambda: None,
) -> Cover:
    """The cover of a mesh from disk, or made in the process and kept; the hull where that takes too
    long, or too much memory.

    Args:
        vertices, triangles, tolerance: as of `convex_cover`.
        began: called where it is not on disk.
        seconds: of processor time that making it may take. The hull is kept, too, where that is
            not enough, so as not to try again each time.
        failed: called where the hull stands in and is not kept.

    Raises:
        StoppedError: nobody wants it any more.
    """

    def make() -> Cover:
        began()
        try:
            return process.cover(vertices, triangles, tolerance, seconds)
        except ProcessorTimeError:
            return hull_cover(vertices, triangles)

    try:
        return kept_cover(vertices, triangles, tolerance, make)
    except (ValueError, TimeoutError):
        failed()
        return hull_cover(vertices, triangles)
