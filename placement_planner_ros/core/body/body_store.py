"""Bodies on disk, for the next process: made once for each content of a large mesh."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.convex_cover import Cover
from placement_planner_ros.core.body.convex_part import ConvexPart
from placement_planner_ros.core.body.covered_mesh import CoveredMesh
from placement_planner_ros.core.body.mesh import Triangles, read_only
from placement_planner_ros.core.body.placement_face import PlacementFace
from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.kept_files import Arrays, found_arrays, keep_arrays, version_of
from placement_planner_ros.core.types import Array, frozen_array

_MANY = 20_000
"""Triangles from which on a body takes longer to make than to read: others are not kept."""

_WHAT = "large objects"


def body_key(
    content: bytes, center: Sequence[float] | None, scale: float, settings: BodySettings
) -> bytes:
    """All that a body depends on.

    Args:
        content: a digest of the mesh, and of how that was read.
        center, scale, settings: as of `Body.from_mesh`.
    """
    of = f"{_version()} {center} {scale!r} {settings!r}".encode()
    return hashlib.sha256(of + b"\0" + content).digest()


def kept_body(key: bytes) -> Body | None:
    """The body that was kept for that key; None where none was."""
    kept = found_arrays(_WHAT, key)
    return None if kept is None else _body(kept)


def keep_body(key: bytes, body: Body) -> None:
    """Keep a body for that key, where its mesh is so large that it pays."""
    if len(body.triangles) > _MANY:
        keep_arrays(_WHAT, key, _arrays(body))


@functools.cache
def _version() -> str:
    files = sorted(path.name for path in Path(__file__).parent.glob("*.py"))
    return f"{version_of(__file__, files)} {version('numpy')} {version('scipy')}"


def _arrays(body: Body) -> Arrays:
    mesh = body.mesh
    parts = body.parts
    whole = mesh is not None and _is_all(mesh, body)
    cover = Cover((), 0.0, closed=False) if mesh is None else mesh.cover
    return {
        "vertices": body.vertices,
        "triangles": body.triangles.astype(np.int32),
        "volume_points": body.volume_points,
        "center_of_mass": body.center_of_mass,
        "numbers": np.array([body.flatness, cover.excess]),
        "counts": np.array(
            [len(body.solids), mesh is not None, whole, cover.closed, body.rolling], np.int64
        ),
        "warnings": np.array(body.warnings, np.str_),
        "assumed": np.array(body.assumed, np.str_),
        **_stacked("part_vertices", [part.vertices for part in parts], (0, 3)),
        **_stacked("part_triangles", [part.triangles for part in parts], (0, 3)),
        **_stacked("part_normals", [part.normals for part in parts], (0, 3)),
        **_stacked("part_offsets", [part.offsets for part in parts], (0,)),
        **_stacked("cover", cover.parts, (0, 3)),
        **_stacked("face_vertices", [face.vertices for face in body.faces], (0, 3)),
        "faces": np.array([_row(face) for face in body.faces]).reshape(-1, 20),
        "mesh_pieces": np.zeros(0, np.int64) if mesh is None else mesh.pieces,
        "mesh_vertices": np.zeros((0, 3)) if mesh is None or whole else mesh.vertices,
        "mesh_triangles": np.zeros((0, 3), np.int32)
        if mesh is None or whole
        else mesh.triangles.astype(np.int32),
    }


def _body(kept: Arrays) -> Body:
    vertices, triangles = frozen_array(kept["vertices"]), read_only(kept["triangles"])
    flatness, excess = kept["numbers"].tolist()
    solids, has_mesh, whole, closed, rolling = kept["counts"].tolist()
    parts = tuple(
        ConvexPart(frozen_array(v), read_only(t), frozen_array(n), frozen_array(o))
        for v, t, n, o in zip(*(_split(kept, f"part_{name}") for name in _PART), strict=True)
    )
    mesh = None
    if has_mesh:
        of = (vertices, triangles) if whole else _own(kept)
        cover = Cover(tuple(_split(kept, "cover")), excess, bool(closed))
        mesh = CoveredMesh(*of, read_only(kept["mesh_pieces"]), cover, parts[solids:])
    faces = zip(_split(kept, "face_vertices"), kept["faces"], strict=True)
    return Body(
        solids=parts[:solids],
        mesh=mesh,
        faces=tuple(_face(*each) for each in faces),
        volume_points=frozen_array(kept["volume_points"]),
        center_of_mass=frozen_array(kept["center_of_mass"]),
        vertices=vertices,
        triangles=triangles,
        warnings=tuple(kept["warnings"].tolist()),
        rolling=rolling,
        assumed=tuple(kept["assumed"].tolist()),
        flatness=flatness,
    )


_PART = "vertices", "triangles", "normals", "offsets"


def _is_all(mesh: CoveredMesh, body: Body) -> bool:
    """Whether the mesh of what is not convex is the object's."""
    return np.array_equal(mesh.vertices, body.vertices) and np.array_equal(
        mesh.triangles, body.triangles
    )


def _own(kept: Arrays) -> tuple[Array, Triangles]:
    return frozen_array(kept["mesh_vertices"]), read_only(kept["mesh_triangles"])


def _row(face: PlacementFace) -> npt.NDArray[np.float64]:
    """(20,) all of a face but its vertices."""
    T = face.T_face_object
    numbers = [face.area, float(face.rolls)]
    return np.concatenate([face.reference, face.normal, T.rotation.ravel(), T.translation, numbers])


def _face(vertices: Array, row: Array) -> PlacementFace:
    reference, normal, rotation, translation = np.split(row[:18], [3, 6, 15])
    return PlacementFace(
        vertices=frozen_array(vertices),
        reference=frozen_array(reference),
        normal=frozen_array(normal),
        T_face_object=pin.SE3(rotation.reshape(3, 3), translation),
        area=float(row[18]),
        rolls=bool(row[19]),
    )


def _stacked(
    name: str, arrays: Sequence[Array] | Sequence[Triangles], none: tuple[int, ...]
) -> Arrays:
    """Arrays one after the other, and how long each is."""
    joined = np.concatenate(arrays) if arrays else np.zeros(none)
    return {name: joined, f"{name}_counts": np.array([len(each) for each in arrays], np.int64)}


def _split(kept: Arrays, name: str) -> list[Array]:
    """What `_stacked` put together."""
    counts = kept[f"{name}_counts"]
    return np.split(kept[name], np.cumsum(counts)[:-1]) if len(counts) else []
