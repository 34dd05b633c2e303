"""What a mesh file's name, size and header show.

Loaders raise whatever they like at a file that is not what its name says, take whatever memory its
header asks for, and may never end. So a header is looked at first; the node reads the rest in a
process of its own.
"""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.parsers import expat

from placement_planner_ros.core.body.mesh import MAX_TRIANGLES, MAX_VERTICES

MAX_BYTES = 64_000_000
"""Bytes that a mesh file may have."""

MAX_UNPACKED = 256_000_000
"""Bytes that may come out of a compressed one."""

_HEADER = 65_536
"""Bytes in which a header of lines must end."""

STL_TEXT = 1000
"""First bytes of an STL file that tell text from numbers, whose count has a zero byte."""


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


def _stl(head: bytes, size: int) -> None:
    if head.lstrip()[:5].lower() == b"solid" and b"\0" not in head[:STL_TEXT]:
        return  # some binary ones begin with that word too
    if len(head) < 84:
        raise ValueError(f"an STL file of {size} bytes holds no triangle")
    (count,) = struct.unpack("<I", head[80:84])
    if 84 + 50 * count > size:
        raise ValueError(
            f"its header says {count} triangles, which take {84 + 50 * count} bytes; the file has "
            f"{size}"
        )
    require_few("triangles", count)


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
                require_few({b"vertex": "vertices", b"face": "faces"}[words[1]], count)
    if least > size - end:
        raise ValueError(f"its header says {least} elements; the file has {size} bytes")


def _off(head: bytes, size: int) -> None:
    lines = [line.split(b"#")[0].split() for line in head.split(b"\n")]
    words = [word for line in lines for word in line][:4]
    if not words or words[0].upper() not in (b"OFF", b"COFF", b"NOFF"):
        raise ValueError("it has no OFF header")
    vertices, faces = _integers(words[1:3], b" ".join(words))
    require_few("vertices", vertices)
    require_few("faces", faces)
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


def require_few(what: str, count: int) -> None:
    """Refuse more vertices or triangles than a mesh may have, as the file or its header says.

    Raises:
        ValueError: there are.
    """
    most = MAX_VERTICES if what == "vertices" else MAX_TRIANGLES
    if count > most:
        raise ValueError(f"it has {count} {what}; a mesh may have {most}")


def _integers(words: list[bytes], line: bytes) -> list[int]:
    try:
        numbers = [int(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != len(words) or not words or min(numbers) < 0:
        raise ValueError(f"its header has a line without counts: {line[:60]!r}")
    return numbers


def check_archive(data: bytes) -> None:
    """Refuse what unpacks to too much; zipfile itself unpacks no more than an entry says."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
        if size > MAX_UNPACKED:
            raise ValueError(f"it unpacks to {size} bytes; it may to {MAX_UNPACKED}")
        for entry in archive.infolist():
            if entry.filename.lower().endswith((".model", ".rels", ".xml")):
                check_xml(archive.read(entry))


def check_xml(data: bytes) -> None:
    """Refuse entities, which name other files, or multiply."""

    def refuse(name: str, *_: object) -> None:
        raise ValueError(f"it defines an entity, {name}")

    parser = expat.ParserCreate()
    parser.EntityDeclHandler = refuse
    parser.Parse(data, True)
