"""Collision geometry of a URDF as coal shapes: primitives as they are, convex meshes as convex
polytopes, all other meshes as their triangles with a convex cover beside them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from urllib.parse import unquote, urlparse

import coal
import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.convex_part import ConvexPart, hull_if_convex, polytope_of
from placement_planner_ros.core.body.covered_mesh import CoveredMesh, CoverMaker
from placement_planner_ros.core.body.mesh_components import Triangles
from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.meshes.read import UNREADABLE, read_mesh
from placement_planner_ros.core.robot.xml_fields import read_floats, read_origin
from placement_planner_ros.core.types import Array

MAX_EXTENT = 15.0
"""m; a mesh larger than this is taken to be in millimetres: rails are up to 12 m long, and what a
finger has in millimetres is more than 15 long. One of less than a ten-thousandth is taken to be
scaled twice: the smallest of 860 that robots come with has 22 mm, scaled twice 0.02."""

PRISM_SIDES = 32
"""Of the prism that stands for a cylinder: 0.5 % of its radius wider."""

MAX_ALL_TRIANGLES = 1_000_000
"""Triangles that all meshes of a robot may have together, each file and scale counted once."""

PackageDirs = Mapping[str, str | Path]
"""Package name -> its share folder; relative paths of meshes are looked for in all of them."""

MeshReader = Callable[[str], tuple[Array, Triangles]]
"""Vertices (n, 3) and triangles (t, 3) of the mesh that a URI names; one of `UNREADABLE` says why
there are none."""


def build_geometry(
    root: ET.Element, model: pin.Model, files: PackageDirs | MeshReader, cover: CoverMaker
) -> tuple[pin.GeometryModel, tuple[str, ...], tuple[CoveredMesh | None, ...], list[str]]:
    """All <collision> elements of a URDF.

    Returns:
        the geometry model without collision pairs; of each of its objects the link and, where it
        is one that is not convex, the mesh, the same for all with its file and scale; and what
        users should know of the meshes.

    Raises:
        RobotError: a geometry is empty, not finite, flat, of another unit, or not found.
    """
    meshes = _Meshes(files if callable(files) else partial(_read_below, files))
    geometry = pin.GeometryModel()
    links: list[str] = []
    shapes: list[coal.CollisionGeometry] = []
    notes: list[str] = []
    # Each shape of each link.
    for link in root.findall("link"):
        name = str(link.get("name"))
        frame_id = model.getFrameId(name, pin.FrameType.BODY)
        frame = model.frames[frame_id]
        for index, element in enumerate(link.findall("collision")):
            field = f"link {name}, collision {index}"
            shape = _read_shape(element, field, meshes)
            if shape is None:
                notes.append(f"{field}: a shape of no size is left out")
                continue
            T = frame.placement * read_origin(element, field)
            thing = pin.GeometryObject(f"{name}_{index}", frame.parentJoint, frame_id, T, shape)
            geometry.addGeometryObject(thing)
            links.append(name)
            shapes.append(shape)
    # Covers of the meshes that are not convex, each once.
    made: dict[int, CoveredMesh] = {}
    sheets: list[str] = []
    for name, shape in zip(links, shapes, strict=True):
        if id(shape) in meshes.surfaces and id(shape) not in made:
            mesh = made[id(shape)] = CoveredMesh.of(*meshes.surfaces[id(shape)], cover)
            if not mesh.cover.closed:
                sheets.append(name)
            if mesh.coarse_in_words:
                notes.append(f"link {name}: {mesh.coarse_in_words}")
    if sheets:
        of = ", ".join(sheets)
        notes.append(f"meshes that are not closed count as sheets without an inside: {of}")
    return geometry, tuple(links), tuple(made.get(id(shape)) for shape in shapes), notes


def _read_shape(
    collision: ET.Element, field: str, meshes: _Meshes
) -> coal.CollisionGeometry | None:
    """The shape; none of a primitive all of whose sizes are 0, which some robots have where nothing
    is."""
    # One shape: a mesh, or a primitive with its sizes.
    shapes = collision.findall("geometry/*")
    if len(shapes) != 1:
        raise RobotError(field, [s.tag for s in shapes], "give it exactly one shape")
    shape = shapes[0]
    if shape.tag == "mesh":
        scale = read_floats(shape.get("scale", "1 1 1"), 3, f"{field}: scale")
        return meshes.shape(shape.get("filename", ""), scale, f"{field}: mesh")
    if shape.tag not in _PRIMITIVES:
        raise RobotError(field, shape.tag, f"use mesh or one of {list(_PRIMITIVES)}")
    # Its sizes, all of them above zero.
    make, counts = _PRIMITIVES[shape.tag]
    sizes = [read_floats(shape.get(a, ""), n, f"{field}: {a}") for a, n in counts.items()]
    values = np.concatenate(sizes)
    if not values.any():
        return None
    if not (values > 0.0).all():
        raise RobotError(f"{field}: {shape.tag}", values.tolist(), "every size must be positive")
    primitive = make(*values.tolist())
    primitive.computeLocalAABB()
    return primitive


def _read_below(package_dirs: PackageDirs, uri: str) -> tuple[Array, Triangles]:
    """The mesh that a URI names: package://, file://, absolute, or relative to a folder."""
    parts = urlparse(uri)
    if parts.scheme not in ("package", "file", ""):
        raise FileNotFoundError("use package://, file:// or a path")
    path, package = unquote(parts.path) if parts.scheme else uri, parts.netloc
    # The folder of its package, or all that it may be below.
    places = [Path(), *map(Path, package_dirs.values())]
    if parts.scheme == "package":
        if not package:
            raise FileNotFoundError("names no package; write two slashes: package://PACKAGE/PATH")
        places = [Path(package_dirs[package])] if package in package_dirs else []
        path = path.lstrip("/")
    for place in places:
        if (place / path).is_file():
            return read_mesh((place / path).resolve())
    tried = ", ".join(map(str, places)) or f"package_dirs, which have no {package}"
    raise FileNotFoundError(f"no such file; tried {tried}")


class _Meshes:
    """The meshes of one robot as shapes, each read once.

    Attributes:
        surfaces: vertices (n, 3), metres, and triangles (t, 3) of those that are not convex, by
            the identity of their shapes.
    """

    def __init__(self, read: MeshReader) -> None:
        self._read = read
        self._made: dict[tuple[str, bytes], coal.CollisionGeometry] = {}
        self._triangles = 0
        self.surfaces: dict[int, tuple[Array, Triangles]] = {}

    def shape(self, uri: str, scale: Array, field: str) -> coal.CollisionGeometry:
        """The mesh a URI names, scaled by (3,) `scale`: a coal.Convex where it is convex, else its
        triangles.

        Raises:
            RobotError: not found, unreadable or unusable.
        """
        # One shape for each file and scale.
        key = uri, scale.tobytes()
        if key not in self._made:
            vertices, triangles = self._scaled(uri, scale, field)
            part = hull_if_convex(vertices[triangles])
            if part is None:
                surface = self._made[key] = triangle_geometry(vertices, triangles)
                self.surfaces[id(surface)] = vertices, triangles
            else:
                self._made[key] = convex_geometry(part)
        return self._made[key]

    def _scaled(self, uri: str, scale: Array, field: str) -> tuple[Array, Triangles]:
        try:
            vertices, triangles = self._read(uri)
        except UNREADABLE as error:
            raise RobotError(field, uri, f"cannot be read: {error}") from error
        # Not too many triangles, together with those before.
        self._triangles += len(triangles)
        if self._triangles > MAX_ALL_TRIANGLES:
            most = f"all meshes of a robot together may have {MAX_ALL_TRIANGLES}"
            words = f"has too many triangles, {self._triangles} with the meshes before it; {most}"
            raise RobotError(field, uri, f"{words}: use simpler collision meshes")
        # A mirrored solid faces outward as before.
        vertices = vertices * scale
        if np.prod(scale) < 0.0:
            triangles = triangles[:, ::-1]
        # Neither larger than a link may be nor smaller.
        extent = float(np.max(np.ptp(vertices, axis=0)))
        if not 1e-4 * MAX_EXTENT <= extent <= MAX_EXTENT:
            raise RobotError(field, uri, f"is {extent:.3g} m long; check its scale (millimetres?)")
        corners = vertices[triangles]
        if not np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any():
            raise RobotError(field, uri, "has no surface; check its scale")
        return vertices, triangles


def convex_geometry(part: ConvexPart) -> coal.Convex:
    """A polytope as a coal shape."""
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    vertices.extend(list(part.vertices))
    triangles.extend([coal.Triangle(*each) for each in part.triangles.tolist()])
    shape = coal.Convex(vertices, triangles)
    shape.computeLocalAABB()
    return shape


def triangle_geometry(vertices: Array, triangles: Triangles) -> coal.BVHModelOBBRSS:
    """Triangles (t, 3) of vertices (n, 3) as a coal surface."""
    mesh = coal.BVHModelOBBRSS()
    # A tree of boxes over all triangles.
    mesh.beginModel(len(triangles), len(vertices))
    mesh.addVertices(np.ascontiguousarray(vertices))
    mesh.addTriangles(np.ascontiguousarray(triangles, np.int32))
    mesh.endModel()
    mesh.computeLocalAABB()
    return mesh


def enclosing_prism(radius: float, length: float) -> coal.Convex:
    """What a cylinder about z counts as: the prism around it."""
    angles = 2.0 * np.pi * np.arange(PRISM_SIDES) / PRISM_SIDES
    rim = np.column_stack([np.cos(angles), np.sin(angles)]) * radius / np.cos(np.pi / PRISM_SIDES)
    ends = [np.column_stack([rim, np.full(PRISM_SIDES, z)]) for z in (-0.5 * length, 0.5 * length)]
    return convex_geometry(polytope_of(np.concatenate(ends)))


_PRIMITIVES = {
    "box": (coal.Box, {"size": 3}),
    "sphere": (coal.Sphere, {"radius": 1}),
    "cylinder": (enclosing_prism, {"radius": 1, "length": 1}),
    "capsule": (coal.Capsule, {"radius": 1, "length": 1}),
}
"""URDF shape -> coal shape, and its attributes with how many numbers each holds."""
