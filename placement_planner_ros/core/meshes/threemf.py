"""Triangles of a 3MF file."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator

import numpy as np

from placement_planner_ros.core.meshes.collada import Triangles
from placement_planner_ros.core.types import Array

_DEEPEST = 100
"""Objects within objects."""
_MOST = 10_000
"""Meshes that a file may place."""


def read_3mf(data: bytes) -> tuple[Array, Triangles]:
    """Vertices (n, 3), in the file's unit, and triangles (t, 3) of a file's contents.

    Raises:
        ValueError: it is no such file, or holds what cannot be read; the message says what.
    """
    models = dict(_models(data))
    if not models:
        raise ValueError("it holds no model")
    main = next((name for name in models if name.lower() == "/3d/3dmodel.model"), min(models))
    vertices, triangles, count = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0
    placed = 0
    for item in models[main].iterfind("build/item"):
        for T, mesh in _placed(models, main, item, np.eye(4), 0):
            placed += 1
            if placed > _MOST:
                raise ValueError(f"it places more than {_MOST} meshes")
            points, faces = _mesh(mesh)
            turned = np.linalg.det(T[:3, :3]) < 0.0
            vertices.append(points @ T[:3, :3].T + T[:3, 3])
            triangles.append((faces[:, ::-1] if turned else faces) + count)
            count += len(points)
    return np.concatenate(vertices), np.concatenate(triangles)


def _models(data: bytes) -> Iterator[tuple[str, ET.Element]]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        for entry in archive.infolist():
            if entry.filename.lower().endswith(".model"):
                try:
                    root = ET.fromstring(archive.read(entry))
                except ET.ParseError as error:
                    raise ValueError(f"its {entry.filename} is no XML: {error}") from error
                for element in root.iter():
                    element.tag = element.tag.rpartition("}")[2]
                yield "/" + entry.filename.lstrip("/"), root


def _placed(
    models: dict[str, ET.Element], name: str, item: ET.Element, T: Array, depth: int
) -> Iterator[tuple[Array, ET.Element]]:
    """Each mesh that an item or component means, with its transform (4, 4)."""
    if depth > _DEEPEST:
        raise ValueError(f"its objects are more than {_DEEPEST} deep")
    T = T @ _transform(item.get("transform"))
    for key, value in item.items():
        if key.rpartition("}")[2] == "path":
            name = value
    wanted = item.get("objectid")
    found = [] if name not in models else models[name].findall("resources/object")
    thing = next((each for each in found if each.get("id") == wanted), None)
    if thing is None:
        raise ValueError(f"it refers to object {wanted} of {name}, which is not in it")
    for mesh in thing.findall("mesh"):
        yield T, mesh
    for component in thing.iterfind("components/component"):
        yield from _placed(models, name, component, T, depth + 1)


def _transform(words: str | None) -> Array:
    T = np.eye(4)
    if words is not None:
        numbers = np.array(words.split(), dtype=np.float64)
        if numbers.shape != (12,):
            raise ValueError(f"a transform has {len(numbers)} numbers, not 12")
        T[:3] = numbers.reshape(4, 3).T  # which the file multiplies from the right
    return T


def _mesh(mesh: ET.Element) -> tuple[Array, Triangles]:
    vertices = [
        [float(v.get(axis, "")) for axis in "xyz"] for v in mesh.iterfind("vertices/vertex")
    ]
    faces = [[int(t.get(f"v{k}", "")) for k in "123"] for t in mesh.iterfind("triangles/triangle")]
    points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    triangles = np.array(faces, dtype=np.int64).reshape(-1, 3)
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(points):
        raise ValueError(f"a triangle has corners that none of {len(points)} vertices is")
    return points, triangles
