"""Triangles of a mesh file, the same for links and objects.

trimesh reads them, a .dae pycollada. An .obj is assimp's, through coal: of several parts whose
faces count vertices from the end trimesh takes others. (What has nodes in nodes coal puts together
wrongly; at a .ply that is cut off it makes faces up, or ends the process.) What these would leave
out without a word, or fill, is refused. Loaders raise whatever they like at a file that is not what
its name says, and take whatever memory it asks for: the node reads in a process of its own.
"""

from __future__ import annotations

import io
import re
import struct
from pathlib import Path

import coal
import collada
import numpy as np
import trimesh
from collada.lineset import BoundLineSet
from collada.polylist import BoundPolylist

from placement_planner_ros.core.body.mesh import MAX_TRIANGLES
from placement_planner_ros.core.body.mesh_components import Triangles
from placement_planner_ros.core.disk_cache import code_digest, digest_of
from placement_planner_ros.core.types import Array, Index

FORMATS = ".stl, .obj, .ply, .off, .glb, .dae"

MAX_BYTES = 64_000_000
"""Bytes that a mesh file may have."""

UNREADABLE = OSError, ValueError
"""What `read_mesh` raises at a file that is not there, or not what its name says."""

_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_UNIT = re.compile(rb"<(?:\w+:)?unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']*)[\"']")
_NO_SURFACE = re.compile(
    rb"<(bind_material|library_(?:images|effects|materials|lights|cameras|animations)|extra)\b"
    rb"(?:[^>]*/>|(?:(?!<\1\b).)*?</\1>)|<instance_(?:camera|light)\b(?:[^>]*/>|.*?</instance_\w+>)",
    re.DOTALL,
)
"""What of a .dae has no surface, the innermost of it: nothing about it can be wrong then."""
_LEFT_OUT = {
    ".dae": re.compile(rb"<(?:\w+:)?(ph|instance_controller|lookat)\b"),
    ".glb": re.compile(
        rb'"(skins|extensionsRequired)"\s*:\s*\[(?!\s*\])|"(sparse|weights|mode"\s*:\s*6)\b|(EXT_mesh\w*)'
    ),
    ".ply": re.compile(rb"\n[ \t]*element[ \t]+(tristrips?)\b"),
}
"""What loaders leave out: polygons with holes; what bones, weights or an extension move; triangle
fans and strips; what pycollada takes otherwise."""
_FACES = re.compile(
    rb"(?m)^[ \t]*(?:element[ \t]+face|(?:\w*OFF )?\d+)[ \t]+(\d+)(?:[ \t]+\d+)?[ \t\r]*(?:#|$)"
)
"""Where a .ply, or a .off, says how many faces it has."""


def check_header(path: Path) -> None:
    """Look at a mesh file's name and size.

    Raises:
        OSError: it is not there.
        ValueError: it cannot be read, or holds too much; the message says why.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS.split(", "):
        raise ValueError(f"{suffix or 'a file without suffix'} is not read; use {FORMATS}")
    size = path.stat().st_size
    if not 0 < size <= MAX_BYTES:
        raise ValueError(f"the file has {size} bytes; a mesh file may have 1 to {MAX_BYTES}")


def content_digest(suffix: str, data: bytes) -> str:
    """A digest of all that `read_mesh` depends on, and of itself.

    Args:
        suffix: of the file's name, in lower case, with the dot.
        data: the file's contents.
    """
    versions = trimesh.__version__, coal.__version__, collada.__version__
    return digest_of(code_digest(__name__), versions, suffix, data)


def read_mesh(path: Path) -> tuple[Array, Triangles]:
    """Vertices (n, 3), equal ones merged, and triangles (t, 3) of a mesh file.

    All meshes of the scene that it shows together, each where the file's transforms put it. In
    metres where the file is a .dae, which states its unit; else in the file's unit, whatever it
    says of it.

    Raises:
        OSError: it cannot be opened.
        ValueError: it cannot be read; the message says why.
    """
    # By its name and size, then by its loader, but for what that would leave out.
    check_header(path)
    suffix, data = path.suffix.lower(), path.read_bytes()
    data = _COMMENT.sub(b"", data) if suffix == ".dae" else data
    if suffix in _LEFT_OUT and (found := _LEFT_OUT[suffix].search(data)):
        what = found[found.lastindex or 0].decode().replace('"', "")
        raise ValueError(f"its {what} is not read; export plain triangles")
    try:
        if suffix == ".obj":
            vertices, triangles = _read_by_assimp(path)
        elif suffix == ".dae":
            vertices, triangles = _read_by_collada(data)
        else:
            vertices, triangles = _read_by_trimesh(suffix, data)
    except (MemoryError, *UNREADABLE):
        raise
    except Exception as error:  # whatever else a loader raises
        raise ValueError(f"{type(error).__name__}: {error}") from error
    # What no mesh may have.
    if len(triangles) == 0:
        raise ValueError("it holds no triangles")
    if len(triangles) > MAX_TRIANGLES:  # before anybody takes memory for more
        raise ValueError(f"it has {len(triangles)} triangles; a mesh may have {MAX_TRIANGLES}")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise ValueError(f"a face has a vertex that is none of the file's {len(vertices)}")
    if bad := int((~np.isfinite(vertices).all(axis=1)).sum()):
        raise ValueError(f"{bad} of its vertices are not finite")
    if suffix in (".ply", ".off") and (told := _FACES.search(data)):
        _require_quads(vertices, triangles, int(told[1]))
    # Equal vertices are one.
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    mesh.merge_vertices()
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


def _read_by_assimp(path: Path) -> tuple[Array, Triangles]:
    try:
        mesh = coal.MeshLoader(coal.NODE_TYPE.BV_AABB).load(str(path), np.ones(3))
    except ValueError as error:
        words = str(error).partition("message:")[2].partition("Hint:")[0]
        raise ValueError(" ".join(words.split()) or "it holds no triangles") from error
    rows = ((each[0], each[1], each[2]) for each in map(mesh.tri_indices, range(mesh.num_tris)))
    return np.array(mesh.vertices()).reshape(-1, 3), np.array(list(rows), np.int64).reshape(-1, 3)


def _read_by_trimesh(suffix: str, data: bytes) -> tuple[Array, Triangles]:
    if suffix == ".stl" and b"\0" in data[:1000] and len(data) >= 84:
        (count,) = struct.unpack("<I", data[80:84])
        data = data[: 84 + 50 * count]  # some programs append to a binary one
    elif suffix in (".stl", ".off"):
        data = data.decode("utf-8", errors="replace").encode()  # names may be in any encoding
    # By its contents alone, so that it cannot name other files, and misses none that it names; a
    # .ply without its picture, whose absence is told at length.
    mesh = trimesh.load_mesh(io.BytesIO(data), suffix[1:], process=False, skip_materials=True)
    if not isinstance(mesh, trimesh.Trimesh):
        raise ValueError("it holds no triangles")
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


def _read_by_collada(data: bytes) -> tuple[Array, Triangles]:
    if b"<!ENTITY" in data or b"\0" in data:  # which names other files, or multiplies
        raise ValueError("it defines an entity, or is not UTF-8")
    scale = float((_UNIT.search(data) or (b"", b"1"))[1])
    if not 0.0 < scale < np.inf:
        raise ValueError(f"its unit is {scale} m; give a number above 0")
    data = _NO_SURFACE.sub(b"", data)
    found = [np.empty((0, 3, 3))]
    for placed in collada.Collada(io.BytesIO(data)).scene.objects("geometry"):
        for part in placed.primitives():
            if isinstance(part, BoundLineSet) or len(part) == 0:
                continue
            # Polygons become fans, each from its first corner.
            fans = part.triangleset() if isinstance(part, BoundPolylist) else part
            fits = fans is part or part.nvertices == len(part.index)
            if fans.vertex_index.min() < 0 or not fits:
                raise ValueError("a polygon has a vertex below 0, or belongs to none")
            corners = scale * np.asarray(fans.vertex[fans.vertex_index], np.float64)
            if fans is not part:
                _require_no_notch(corners, np.maximum(np.diff(part.polyindex)[:, 0] - 2, 0))
            # A mirrored solid faces outward as before.
            turn = np.linalg.det(placed.matrix[:3, :3])
            found.append(corners if turn > 0.0 else corners[:, ::-1])
    vertices = np.concatenate(found).reshape(-1, 3)
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def _require_quads(vertices: Array, triangles: Triangles, faces: int) -> None:
    """Refuse what trimesh made of so many faces unless they are triangles, which come first, and
    convex quadrilaterals: their first halves, then their second ones."""
    quads = len(triangles) - faces
    halves = (
        triangles[faces - quads :].reshape(2, -1, 3) if 0 <= quads <= faces else triangles[None]
    )
    if not np.array_equal(halves[0][:, [0, 2]], halves[-1][:, [2, 0]]):
        raise ValueError("faces are missing or have more than four corners; export triangles")
    _require_no_notch(vertices[halves.swapaxes(0, 1).reshape(-1, 3)], np.full(quads, 2))


def _require_no_notch(corners: Array, counts: Index) -> None:
    """Refuse fans (t, 3, 3), so many triangles for each polygon, that reach out of a polygon by
    more than six digits of a coordinate are worth."""
    sides = np.roll(corners, -1, axis=1) - corners
    normals = np.cross(sides[:, 0], sides[:, 1])
    polygon = np.repeat(np.arange(len(counts)), counts)
    whole = np.zeros((len(counts), 3))
    np.add.at(whole, polygon, normals)
    whole = whole[polygon]
    # Twice the area beyond, against that of a strip along the longest side.
    area = np.linalg.norm(whole, axis=1) * np.linalg.norm(sides, axis=2).max(axis=1, initial=0.0)
    least = -1e-5 * np.abs(corners).max(initial=0.0) * area
    if ((normals * whole).sum(axis=1) < least).any():
        raise ValueError("one of its polygons has a notch; export plain triangles")
