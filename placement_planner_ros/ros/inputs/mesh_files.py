"""Mesh files: what their headers show, and their contents.

Loaders raise whatever they like at a file that is not what its name says, take whatever memory its
header asks for, and may never end. So a header is looked at first, and the rest is read in a
process of its own, see `mesh_process`.
"""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.parsers import expat

import numpy as np
import numpy.typing as npt
import trimesh

from placement_planner_ros.core.body.mesh import MAX_TRIANGLES
from placement_planner_ros.core.types import Array

Triangles = npt.NDArray[np.int64]

MAX_BYTES = 64_000_000
"""Bytes that a mesh file may have."""

MAX_UNPACKED = 256_000_000
"""Bytes that may come out of a compressed one."""

_HEADER = 65_536
"""Bytes in which a header of lines must end."""

_NEEDS = {".dae": "pycollada", ".3mf": "lxml and networkx"}
"""Formats that need further Python packages."""


def check_header(path: Path) -> None:
    """Look at what a mesh file's name, size and header show.

    Raises:
        OSError: it cannot be opened.
        ValueError: it cannot be read, or holds too much; the message says why.
    """
    suffix = path.suffix.lower()
    if suffix not in _HEADERS:
        raise ValueError(f"{suffix or 'a file without suffix'} is not read; use {FORMATS}")
    size = path.stat().st_size
    if size == 0:
        raise ValueError("the file is empty")
    if size > MAX_BYTES:
        raise ValueError(f"the file has {size} bytes; a mesh file may have {MAX_BYTES}")
    with path.open("rb") as file:
        _HEADERS[suffix](file.read(_HEADER), size)


def read_object(path: Path) -> tuple[Array, Triangles]:
    """Vertices (n, 3) and triangles (t, 3) of a mesh file, in the file's unit.

    Raises:
        Exception: of whatever kind; its message says why the file cannot be read.
    """
    check_header(path)
    suffix = path.suffix.lower()
    data = path.read_bytes()
    if suffix == ".3mf":
        _check_archive(data)
    elif suffix == ".dae":
        _check_xml(data)
    # By its contents alone, so that it cannot name other files.
    try:
        mesh = trimesh.load_mesh(io.BytesIO(data), file_type=suffix[1:], process=False)
    except (ImportError, NotImplementedError, ValueError) as error:
        if suffix in _NEEDS and f"{suffix[1:]}" not in trimesh.available_formats():
            raise ValueError(
                f"{suffix} files need the Python packages {_NEEDS[suffix]}; install them, or "
                "convert the file"
            ) from error
        raise
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise ValueError("it holds no triangles")
    bad = int((~np.isfinite(mesh.vertices).all(axis=1)).sum())
    if bad:
        raise ValueError(f"{bad} of its vertices are NaN or infinite")
    mesh.merge_vertices()
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


def _stl(head: bytes, size: int) -> None:
    if head.lstrip()[:5].lower() == b"solid":
        return
    if len(head) < 84:
        raise ValueError(f"an STL file of {size} bytes holds no triangle")
    (count,) = struct.unpack("<I", head[80:84])
    if 84 + 50 * count > size:
        raise ValueError(
            f"its header says {count} triangles, which take {84 + 50 * count} bytes; the file has "
            f"{size}"
        )
    _few("triangles", count)


def _ply(head: bytes, size: int) -> None:
    end = head.find(b"end_header")
    if not head.startswith(b"ply") or end < 0:
        raise ValueError("it has no PLY header")
    least = 0
    for line in head[:end].split(b"\n"):
        words = line.split()
        if words[:1] == [b"element"]:
            count = _integers(words[2:3], line)[0]
            least += count
            if words[1:2] in ([b"vertex"], [b"face"]):
                _few(words[1].decode(), count)
    if least > size - end:
        raise ValueError(f"its header says {least} elements; the file has {size} bytes")


def _off(head: bytes, size: int) -> None:
    lines = [line.split(b"#")[0].split() for line in head.split(b"\n")]
    words = [word for line in lines for word in line][:4]
    if not words or words[0].upper() not in (b"OFF", b"COFF", b"NOFF"):
        raise ValueError("it has no OFF header")
    vertices, faces = _integers(words[1:3], b" ".join(words))
    _few("vertices", vertices)
    _few("faces", faces)
    if 2 * (vertices + faces) > size:
        raise ValueError(
            f"its header says {vertices} vertices and {faces} faces; the file has {size} bytes"
        )


def _glb(head: bytes, size: int) -> None:
    if head[:4] != b"glTF" or len(head) < 20:
        raise ValueError("it has no GLB header")
    version, length = struct.unpack("<II", head[4:12])
    if version != 2 or length > size:
        raise ValueError(
            f"its header says version {version}, {length} bytes; version 2 is read, and the file "
            f"has {size} bytes"
        )


def _3mf(head: bytes, size: int) -> None:
    if head[:4] != b"PK\x03\x04":
        raise ValueError(f"it is no 3MF archive, by its first of {size} bytes")


def _text(head: bytes, size: int) -> None:
    if b"\0" in head and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ValueError(f"it is no text, by the first of its {size} bytes")


_HEADERS: dict[str, Callable[[bytes, int], None]] = {
    ".stl": _stl,
    ".obj": _text,
    ".ply": _ply,
    ".off": _off,
    ".glb": _glb,
    ".dae": _text,
    ".3mf": _3mf,
}
FORMATS = ", ".join(_HEADERS)


def _few(what: str, count: int) -> None:
    if count > MAX_TRIANGLES:
        raise ValueError(f"its header says {count} {what}; a mesh may have {MAX_TRIANGLES}")


def _integers(words: list[bytes], line: bytes) -> list[int]:
    try:
        numbers = [int(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != len(words) or not words or min(numbers) < 0:
        raise ValueError(f"its header has a line without counts: {line[:60]!r}")
    return numbers


def _check_archive(data: bytes) -> None:
    """Refuse what unpacks to too much; zipfile itself unpacks no more than an entry says."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
        if size > MAX_UNPACKED:
            raise ValueError(f"it unpacks to {size} bytes; it may to {MAX_UNPACKED}")
        for entry in archive.infolist():
            if entry.filename.lower().endswith((".model", ".rels", ".xml")):
                _check_xml(archive.read(entry))


def _check_xml(data: bytes) -> None:
    """Refuse entities, which name other files, or multiply."""

    def refuse(name: str, *_: object) -> None:
        raise ValueError(f"it defines an entity, {name}")

    parser = expat.ParserCreate()
    parser.EntityDeclHandler = refuse
    parser.Parse(data, True)
