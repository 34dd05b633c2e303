"""What tells a mesh file's triangles from others without reading them."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

import trimesh


def content_digest(suffix: str, data: bytes) -> bytes:
    """A digest of all that `mesh_of` depends on, and of itself.

    Args:
        suffix: of the file's name, in lower case, with the dot.
        data: the file's contents.
    """
    return hashlib.blake2b(_readers() + suffix.encode() + b"\0" + data, digest_size=32).digest()


@functools.cache
def _readers() -> bytes:
    """Of what reads meshes."""
    digest = hashlib.sha256(str(trimesh.__version__).encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.digest()
