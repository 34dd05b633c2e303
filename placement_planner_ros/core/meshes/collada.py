"""Triangles of a COLLADA (.dae) file.

As RViz has them: nodes' transforms and the unit count, the up-axis does not. What has no surface
(materials, textures, lights, bones) is not looked at, so that nothing about it can be wrong. What
has one and cannot be understood is an error, never left out: a robot would lose a part of itself.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.types import Array

Triangles = npt.NDArray[np.int64]

_DEEPEST = 100
"""Nodes within nodes."""
_MOST = 10_000
"""Meshes that nodes may place."""
_SILENT = {"lines", "linestrips", "spline"}
"""Geometry without surface."""


def read_collada(data: bytes) -> tuple[Array, Triangles]:
    """Vertices (n, 3), in metres, and triangles (t, 3) of a file's contents.

    Raises:
        ValueError: it is no such file, or holds what cannot be read; the message says what.
    """
    try:
        root = ET.fromstring(data)
    except ET.ParseError as error:
        raise ValueError(f"it is no XML: {error}") from error
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    if root.tag != "COLLADA":
        raise ValueError(f"its root is <{root.tag}>, not <COLLADA>")
    return _Reader(root).read()


class _Reader:
    """One file."""

    def __init__(self, root: ET.Element) -> None:
        self._root = root
        self._named = {str(e.get("id")): e for e in root.iter() if e.get("id") is not None}
        self._geometries: dict[str, list[tuple[Array, Triangles]]] = {}

    def read(self) -> tuple[Array, Triangles]:
        unit = self._unit()
        vertices, triangles, count = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0
        for placed, (T, name) in enumerate(self._instances()):
            if placed >= _MOST:
                raise ValueError(f"its nodes place more than {_MOST} meshes")
            if name not in self._geometries:
                self._geometries[name] = list(self._geometry(self._named[name]))
            turned = np.linalg.det(T[:3, :3]) < 0.0
            for points, faces in self._geometries[name]:
                vertices.append(unit * (points @ T[:3, :3].T + T[:3, 3]))
                triangles.append((faces[:, ::-1] if turned else faces) + count)
                count += len(points)
        return np.concatenate(vertices), np.concatenate(triangles)

    def _unit(self) -> float:
        """Metres per unit."""
        element = self._root.find("asset/unit")
        words = "1" if element is None else element.get("meter", "1")
        try:
            unit = float(words)
        except ValueError:
            unit = math.nan
        if not (math.isfinite(unit) and unit > 0.0):
            raise ValueError(f"its unit is {words!r} m; give a number above 0")
        return unit

    def _instances(self) -> Iterator[tuple[Array, str]]:
        """Every placed geometry: its transform (4, 4) and id."""
        given = self._root.find("scene/instance_visual_scene")
        scene = self._root.find("library_visual_scenes/visual_scene")
        if given is not None:
            scene = self._referred(given)
        if scene is None:  # nothing is placed: all of it is where it is
            for geometry in self._root.iterfind("library_geometries/geometry"):
                if geometry.get("id") is not None:
                    yield np.eye(4), str(geometry.get("id"))
            return
        for node in scene.findall("node"):
            yield from self._placed(node, np.eye(4), 0)

    def _placed(self, node: ET.Element, T: Array, depth: int) -> Iterator[tuple[Array, str]]:
        if depth > _DEEPEST:
            raise ValueError(f"its nodes are more than {_DEEPEST} deep")
        for child in node:
            if child.tag in _TRANSFORMS:
                T = T @ _transform(child)
        for child in node:
            if child.tag == "node":
                yield from self._placed(child, T, depth + 1)
            elif child.tag == "instance_node":
                yield from self._placed(self._referred(child), T, depth + 1)
            elif child.tag == "instance_geometry":
                yield T, str(self._referred(child).get("id"))
            elif child.tag == "instance_controller":
                yield T, str(self._skinned(child).get("id"))

    def _skinned(self, instance: ET.Element) -> ET.Element:
        """The geometry that bones or targets would move, at rest."""
        element = self._referred(instance)
        for _ in range(_DEEPEST):
            if element.tag != "controller":
                return element
            source = next((e for e in element if e.tag in ("skin", "morph")), None)
            if source is None:
                break
            element = self._referred(source, "source")
        raise ValueError(f"controller {instance.get('url')} moves no geometry")

    def _referred(self, element: ET.Element, attribute: str = "url") -> ET.Element:
        name = element.get(attribute, "")
        if not name.startswith("#") or name[1:] not in self._named:
            raise ValueError(f"<{element.tag}> refers to {name!r}, which is not in the file")
        return self._named[name[1:]]

    def _geometry(self, geometry: ET.Element) -> Iterator[tuple[Array, Triangles]]:
        """Each of its primitives: vertices (n, 3) and triangles (t, 3)."""
        for shape in geometry:
            if shape.tag in ("asset", "extra") or shape.tag in _SILENT:
                continue
            if shape.tag != "mesh":
                raise ValueError(f"geometry {geometry.get('id')} is a {shape.tag}, not a mesh")
            for primitive in shape:
                if primitive.tag in _PRIMITIVES:
                    yield self._primitive(primitive)

    def _primitive(self, primitive: ET.Element) -> tuple[Array, Triangles]:
        inputs = primitive.findall("input")
        offsets = [_count(each.get("offset", "0")) for each in inputs]
        corner = next((i for i, e in enumerate(inputs) if e.get("semantic") == "VERTEX"), None)
        if corner is None:
            raise ValueError(f"<{primitive.tag}> has no vertices")
        stride = 1 + max(offsets)
        corners = []
        for p in [*primitive.findall("p"), *primitive.findall("ph/p")]:
            numbers = _integers(p)
            if len(numbers) % stride:
                raise ValueError(f"<{primitive.tag}> has {len(numbers)} indices, {stride} a corner")
            corners.append(numbers.reshape(-1, stride)[:, offsets[corner]])
        counts = primitive.find("vcount")
        triangles = _PRIMITIVES[primitive.tag](
            corners, np.empty(0, np.int64) if counts is None else _integers(counts)
        )
        points = self._positions(self._referred(inputs[corner], "source"))
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(points):
            raise ValueError(f"<{primitive.tag}> has corners that none of {len(points)} points is")
        return points, triangles

    def _positions(self, vertices: ET.Element) -> Array:
        """Points (n, 3) of a <vertices>, or of a <source>."""
        if vertices.tag == "vertices":
            for each in vertices.findall("input"):
                if each.get("semantic") == "POSITION":
                    return self._positions(self._referred(each, "source"))
            raise ValueError(f"<vertices> {vertices.get('id')} have no positions")
        array, accessor = vertices.find("float_array"), vertices.find("technique_common/accessor")
        if accessor is not None and accessor.get("source") is not None:
            array = self._referred(accessor, "source")
        if array is None:
            raise ValueError(f"source {vertices.get('id')} has no <float_array>")
        numbers = _floats(array)
        if accessor is None:
            stride, start, columns, count = 3, 0, [0, 1, 2], len(numbers) // 3
        else:
            names = [str(p.get("name", "")).upper() for p in accessor.findall("param")]
            known = [names.index(axis) for axis in "XYZ" if axis in names]
            columns = known if len(known) == 3 else [0, 1, 2]
            stride = _count(accessor.get("stride", "1"))
            start = _count(accessor.get("offset", "0"))
            count = _count(accessor.get("count", "0"))
        if stride <= max(columns) or start + count * stride > len(numbers):
            raise ValueError(
                f"source {vertices.get('id')} has {len(numbers)} numbers, not {count} points of "
                f"{stride} each"
            )
        return numbers[start : start + count * stride].reshape(-1, stride)[:, columns]


def _floats(element: ET.Element) -> Array:
    try:
        return np.array((element.text or "").split(), dtype=np.float64)
    except ValueError as error:
        raise ValueError(f"<{element.tag}> holds what is no number: {error}") from error


def _integers(element: ET.Element) -> npt.NDArray[np.int64]:
    try:
        return np.array((element.text or "").split(), dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"<{element.tag}> holds what is no number: {error}") from error


def _count(words: str) -> int:
    if not (words.isascii() and words.isdigit() and len(words) < 12):
        raise ValueError(f"{words!r} is no count")
    return int(words)


def _transform(element: ET.Element) -> Array:
    values = _floats(element)
    wanted = _TRANSFORMS[element.tag]
    if len(values) != wanted:
        raise ValueError(f"<{element.tag}> has {len(values)} numbers, not {wanted}")
    T = np.eye(4)
    if element.tag == "matrix":
        return values.reshape(4, 4)
    if element.tag == "translate":
        T[:3, 3] = values
    elif element.tag == "scale":
        T[:3, :3] = np.diag(values)
    elif element.tag == "rotate":
        length, angle = float(np.linalg.norm(values[:3])), math.radians(values[3])
        if length > 0.0:
            x, y, z = values[:3] / length
            K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            T[:3, :3] += math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K
    else:
        raise ValueError(f"<{element.tag}> in a node is not read; export it as a matrix")
    return T


_TRANSFORMS = {"matrix": 16, "translate": 3, "scale": 3, "rotate": 4, "lookat": 9, "skew": 7}
"""Elements of a node that move what it holds, and how many numbers each has."""

Corners = list[npt.NDArray[np.int64]]


def _triangles(corners: Corners, counts: npt.NDArray[np.int64]) -> Triangles:
    if any(len(each) % 3 for each in corners):
        raise ValueError("<triangles> have corners left over")
    return np.concatenate([np.empty(0, np.int64), *corners]).reshape(-1, 3)


def _polylist(corners: Corners, counts: npt.NDArray[np.int64]) -> Triangles:
    every = np.concatenate([np.empty(0, np.int64), *corners])
    if (counts < 0).any() or counts.sum() != len(every):
        raise ValueError(f"<polylist> counts {counts.sum()} corners and has {len(every)}")
    starts = np.cumsum(counts) - counts
    # A fan of triangles holds all of its polygon, whether that is convex or not.
    fans = np.repeat(np.arange(len(counts)), np.maximum(counts - 2, 0))
    first = np.flatnonzero(np.diff(fans, prepend=-1))
    step = np.arange(len(fans)) - np.repeat(first, np.diff(np.append(first, len(fans))))
    start = starts[fans]
    return every[np.stack([start, start + step + 1, start + step + 2], axis=1)]


def _polygons(corners: Corners, counts: npt.NDArray[np.int64]) -> Triangles:
    return _polylist(corners, np.array([len(each) for each in corners], np.int64))


def _strips(corners: Corners, counts: npt.NDArray[np.int64]) -> Triangles:
    found = [np.empty((0, 3), np.int64)]
    for each in corners:
        rows = np.stack([each[:-2], each[1:-1], each[2:]], axis=1)
        rows[1::2] = rows[1::2, ::-1]
        found.append(rows)
    return np.concatenate(found)


_PRIMITIVES: dict[str, Callable[[Corners, npt.NDArray[np.int64]], Triangles]] = {
    "triangles": _triangles,
    "polylist": _polylist,
    "polygons": _polygons,
    "trifans": _polygons,
    "tristrips": _strips,
}
