"""Triangles of a mesh file, the same for links and objects."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import trimesh

from placement_planner_ros.core.meshes.collada import Triangles, read_collada
from placement_planner_ros.core.meshes.headers import (
    STL_TEXT,
    check_archive,
    check_header,
    check_xml,
    require_few,
)
from placement_planner_ros.core.meshes.threemf import read_3mf
from placement_planner_ros.core.meshes.wavefront import absolute_faces
from placement_planner_ros.core.types import Array

FURTHEST = 1e9
"""Greatest coordinate; of some that are a hundred times as large equal and different ones are not
told apart."""


def read_mesh(path: Path) -> tuple[Array, Triangles]:
    """Vertices (n, 3), equal ones merged, and triangles (t, 3) of a mesh file.

    All meshes and scenes in it together, each where the file's transforms put it. In metres where
    the file is a .dae, which states its unit; else in the file's unit, whatever it says of it.

    Raises:
        OSError: it cannot be opened.
        ValueError: it cannot be read; the message says why.
        Exception: whatever else loaders raise at what they are given.
    """
    check_header(path)
    return mesh_of(path.suffix.lower(), path.read_bytes())


def mesh_of(suffix: str, data: bytes) -> tuple[Array, Triangles]:
    """`read_mesh` of a file's contents whose header was looked at.

    Args:
        suffix: of its name, in lower case, with the dot.
    """
    vertices, triangles = _contents(suffix, data)
    if len(triangles) == 0:
        raise ValueError("it holds no triangles")
    require_few("triangles", len(triangles))  # before anybody takes memory for more
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise ValueError(f"a face has a vertex that is none of the file's {len(vertices)}")
    bad = int((~np.isfinite(vertices).all(axis=1)).sum())
    if bad:
        raise ValueError(f"{bad} of its vertices are not finite")
    furthest = float(np.abs(vertices).max())
    if furthest > FURTHEST:
        raise ValueError(
            f"its coordinates reach {furthest:.3g}, too large in any unit; no more than "
            f"{FURTHEST:g} is read: export it anew, best in metres"
        )
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    mesh.merge_vertices()
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


def _contents(suffix: str, data: bytes) -> tuple[Array, Triangles]:
    if suffix == ".dae":
        check_xml(data)
        return read_collada(data)
    if suffix == ".3mf":
        check_archive(data)
        return read_3mf(data)
    if suffix == ".stl":
        data = _one_stl(data)
    elif suffix == ".obj":
        data = absolute_faces(_utf8(data))
    elif suffix == ".off":
        data = _utf8(data)
    # By its contents alone, so that it cannot name other files, and misses none that it names.
    # Without the picture that a PLY may name, whose absence is told at length.
    plain = {"skip_materials": True} if suffix == ".ply" else {}
    mesh = trimesh.load_mesh(io.BytesIO(data), file_type=suffix[1:], process=False, **plain)
    if not isinstance(mesh, trimesh.Trimesh):
        raise ValueError("it holds no triangles")
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


def _one_stl(data: bytes) -> bytes:
    """Without what some programs append to a binary one."""
    if b"\0" not in data[:STL_TEXT]:
        return _utf8(data)
    (count,) = struct.unpack("<I", data[80:84])
    return data[: 84 + 50 * count]


def _utf8(data: bytes) -> bytes:
    """A text whose names and comments may be in another encoding."""
    try:
        data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1").encode()
    return data
