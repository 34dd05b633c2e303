"""Collision geometry of a URDF as coal shapes: primitives as they are, convex meshes as convex
polytopes, all other meshes as their triangles with a convex cover beside them."""

from __future__ import annotations

import functools
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol
from urllib.parse import unquote, urlparse

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.body.convex_cover import (
    Cover,
    coarse_cover_in_words,
    convex_cover,
    cover_tolerance,
)
from placement_planner_ros.core.body.convex_part import ConvexPart, hull_if_convex, polytope_of
from placement_planner_ros.core.body.covered_mesh import kept_cover
from placement_planner_ros.core.body.mesh import MAX_TRIANGLES
from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.meshes.read import UNREADABLE, read_mesh
from placement_planner_ros.core.robot.description import MAX_PARTS
from placement_planner_ros.core.robot.xml_fields import read_floats, read_origin
from placement_planner_ros.core.types import Array

MAX_EXTENT = 15.0
"""m; a mesh larger than this is taken to be in millimetres: rails are up to 12 m long, and what a
finger has in millimetres is more than 15 long."""

PRIMITIVES = {
    "box": (coal.Box, {"size": 3}),
    "sphere": (coal.Sphere, {"radius": 1}),
    "cylinder": (coal.Cylinder, {"radius": 1, "length": 1}),
    "capsule": (coal.Capsule, {"radius": 1, "length": 1}),
}
"""URDF shape -> coal shape, and its attributes with how many numbers each holds."""

MAX_ALL_TRIANGLES = 1_000_000
"""Triangles that all meshes of a robot may have together, each file counted once."""

PackageDirs = Mapping[str, str | Path] | Sequence[str | Path]
"""Package name -> its share folder, or folders that hold packages or relative mesh paths."""

Triangles = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class LinkMesh:
    """A mesh that is not convex, as a link has it.

    Attributes:
        link: for messages.
        vertices: (n, 3) metres, scaled.
        triangles: (t, 3) rows of vertices.
    """

    link: str
    vertices: Array
    triangles: Triangles

    @property
    def tolerance(self) -> float:
        """Metres that its cover may reach beyond it."""
        return cover_tolerance(self.vertices)


@dataclass(frozen=True, slots=True, eq=False)
class LinkCover(Cover):
    """The cover of a link's mesh, and the mesh."""

    mesh: LinkMesh


CoverMaker = Callable[[Sequence[LinkMesh]], Sequence[Cover]]
"""Makes the covers of all meshes of a robot."""


def make_covers(meshes: Sequence[LinkMesh]) -> list[Cover]:
    """The covers of these meshes, from disk where they were made before."""
    # Each within the tolerance of its size.
    arguments = [(mesh.vertices, mesh.triangles, mesh.tolerance) for mesh in meshes]
    return [kept_cover(*each, functools.partial(convex_cover, *each)) for each in arguments]


def _notes_on(meshes: Sequence[LinkMesh], covers: Sequence[Cover]) -> list[str]:
    """What users should know of the meshes."""
    notes = []
    for mesh, cover in zip(meshes, covers, strict=True):
        if not cover.closed:
            notes.append(
                f"link {mesh.link}: its mesh is not closed and counts as a sheet without an inside"
            )
        if words := coarse_cover_in_words(cover, mesh.tolerance):
            notes.append(f"link {mesh.link}: {words}")
    return notes


class MeshFiles(Protocol):
    """Finds and reads the meshes that a URDF names."""

    def find(self, uri: str) -> Path:
        """The file that a mesh's URI names; an OSError says why there is none."""
        ...

    def read(self, path: Path) -> tuple[Array, Triangles]:
        """Vertices (n, 3) and triangles (t, 3); one of `UNREADABLE` says why there are none."""
        ...


def build_geometry(
    root: ET.Element, model: pin.Model, files: PackageDirs | MeshFiles, cover: CoverMaker
) -> tuple[pin.GeometryModel, tuple[str, ...], tuple[LinkCover | None, ...], list[str]]:
    """All <collision> elements of a URDF.

    Returns:
        the geometry model without collision pairs; of each of its objects the link and, where it
        is a mesh that is not convex, the cover, one for all that share the mesh and its scale; and
        what users should know of the meshes.

    Raises:
        RobotError: a geometry is empty, not finite, flat, in millimetres, too large or not found.
    """
    # Not too many, and each file read once.
    count = sum(1 for _ in root.iterfind("link/collision"))
    if count > MAX_PARTS:
        raise RobotError(
            "`urdf`",
            f"{count} collision shapes",
            f"is more than a robot may have, {MAX_PARTS}",
        )
    meshes = _Meshes(_Folders(files) if isinstance(files, (Mapping, Sequence)) else files)
    geometry = pin.GeometryModel()
    links: list[str] = []
    keys: list[_Key | None] = []
    points: list[str] = []
    # Each shape of each link.
    for link in root.findall("link"):
        name = str(link.get("name"))
        frame_id = model.getFrameId(name, pin.FrameType.BODY)
        frame = model.frames[frame_id]
        for index, element in enumerate(link.findall("collision")):
            field = f"link {name}, collision {index}"
            read = _read_shape(element, name, field, meshes)
            if read is None:
                points.append(f"{field}: a shape of no size is left out")
                continue
            shape, key = read
            geometry.addGeometryObject(
                pin.GeometryObject(
                    f"{name}_{index}",
                    frame.parentJoint,
                    frame_id,
                    frame.placement * read_origin(element, field),
                    shape,
                )
            )
            links.append(name)
            keys.append(key)
    # Covers of the meshes that are not convex.
    soups = list(meshes.soups.values())
    made = [
        LinkCover(each.parts, each.excess, each.closed, soup)
        for each, soup in zip(cover(soups), soups, strict=True)
    ]
    by_key = dict(zip(meshes.soups, made, strict=True))
    covers = tuple(None if key is None else by_key.get(key) for key in keys)
    return geometry, tuple(links), covers, points + _notes_on(soups, made)


_Key = tuple[Path, tuple[float, ...]]
"""A mesh file and its scale."""


def _read_shape(
    collision: ET.Element, link: str, field: str, meshes: _Meshes
) -> tuple[coal.CollisionGeometry, _Key | None] | None:
    """The shape and, of a mesh, its key; None of a primitive all of whose sizes are 0, which
    some robots have where nothing is."""
    # One shape: a mesh, or a primitive with its sizes.
    geometry = collision.find("geometry")
    shapes = [] if geometry is None else list(geometry)
    if len(shapes) != 1:
        raise RobotError(field, [s.tag for s in shapes], "give it exactly one shape")
    shape = shapes[0]
    if shape.tag == "mesh":
        scale = read_floats(shape.get("scale", "1 1 1"), 3, f"{field}: scale")
        return meshes.shape(shape.get("filename", ""), scale, link, field)
    if shape.tag not in PRIMITIVES:
        raise RobotError(field, shape.tag, f"use mesh or one of {list(PRIMITIVES)}")
    # Its sizes, all of them above zero.
    make, counts = PRIMITIVES[shape.tag]
    sizes = [read_floats(shape.get(a, ""), n, f"{field}: {a}") for a, n in counts.items()]
    values = np.concatenate(sizes)
    if not values.any():
        return None
    if not (values > 0.0).all():
        raise RobotError(f"{field}: {shape.tag}", values.tolist(), "every size must be positive")
    primitive = make(*values.tolist())
    primitive.computeLocalAABB()
    return primitive, None


class _Folders:
    """Mesh files below package folders."""

    def __init__(self, package_dirs: PackageDirs) -> None:
        named = package_dirs.items() if isinstance(package_dirs, Mapping) else None
        self._named = [(name, Path(folder)) for name, folder in named or ()]
        self._folders = [] if named else [Path(folder) for folder in package_dirs]

    def find(self, uri: str) -> Path:
        """The file a mesh URI names: package://, file://, absolute, or relative to a folder."""
        parts = urlparse(uri)
        path, package = unquote(parts.path), parts.netloc
        if parts.scheme not in ("package", "file", ""):
            raise FileNotFoundError("use package://, file:// or a path")
        if parts.scheme == "package" and not package:
            raise FileNotFoundError("names no package; write two slashes: package://PACKAGE/PATH")
        # Folders that it may be below, and its path from there.
        places = [Path()]
        if parts.scheme == "package":
            named = [*self._named, *((folder.name, folder) for folder in self._folders)]
            places = [folder for name, folder in named if name == package]
            places += [folder / package for folder in self._folders]
            path = path.lstrip("/")
        elif not parts.scheme:
            places += [*(folder for _, folder in self._named), *self._folders]
            path = uri
        for place in places:
            if (place / path).is_file():
                return (place / path).resolve()
        tried = ", ".join(map(str, places)) or f"package_dirs, which have no {package}"
        raise FileNotFoundError(f"no such file; tried {tried}")

    def read(self, path: Path) -> tuple[Array, Triangles]:
        """Vertices and triangles of a file."""
        return read_mesh(path)


class _Meshes:
    """The meshes of one robot as shapes, each read once.

    Attributes:
        soups: those that are not convex.
    """

    def __init__(self, files: MeshFiles) -> None:
        self._files = files
        self._read: dict[Path, tuple[Array, Triangles]] = {}
        self._shapes: dict[_Key, coal.CollisionGeometry] = {}
        self.soups: dict[_Key, LinkMesh] = {}
        self._triangles = 0

    def shape(
        self, uri: str, scale: Array, link: str, field: str
    ) -> tuple[coal.CollisionGeometry, _Key]:
        """The mesh a URI names, scaled by (3,) `scale`.

        Raises:
            RobotError: not found, unreadable or unusable.
        """
        try:
            path = self._files.find(uri)
        except (OSError, ValueError) as error:  # ValueError: no URI, or a null in a path
            raise RobotError(f"{field}: mesh", uri, str(error)) from error
        # One shape for each file and scale.
        key = (path, tuple(scale))
        if key not in self._shapes:
            if path not in self._read:
                self._read[path] = self._arrays(path, field)
            # The file, read when it is first asked for.
            vertices, triangles = self._read[path]
            if np.prod(scale) < 0.0:
                triangles = triangles[:, ::-1]  # a mirrored solid faces outward as before
            shape = mesh_shape(vertices, triangles, scale, f"{field}: mesh", str(path))
            self._shapes[key] = shape
            if isinstance(shape, coal.BVHModelBase):
                self.soups[key] = LinkMesh(link, vertices * scale, triangles)
        return self._shapes[key], key

    def _arrays(self, path: Path, field: str) -> tuple[Array, Triangles]:
        try:
            vertices, triangles = self._files.read(path)
        except UNREADABLE as error:
            reason = str(error) or type(error).__name__
            raise RobotError(f"{field}: mesh", str(path), f"cannot be read: {reason}") from error
        # Too many triangles, here or together with those before.
        self._triangles += len(triangles)
        if len(triangles) > MAX_TRIANGLES or self._triangles > MAX_ALL_TRIANGLES:
            raise RobotError(
                f"{field}: mesh",
                str(path),
                f"has {len(triangles)} triangles, {self._triangles} with the meshes before it; a "
                f"mesh may have {MAX_TRIANGLES}, all meshes of a robot together "
                f"{MAX_ALL_TRIANGLES}: use simpler collision meshes",
            )
        return vertices, triangles


def mesh_shape(
    vertices: Array, triangles: Triangles, scale: Array, field: str, name: str
) -> coal.CollisionGeometry:
    """A mesh scaled by (3,) `scale`: a coal.Convex where it is convex, else a BVH.

    Raises:
        RobotError: empty, not finite, degenerate or larger than `MAX_EXTENT`.
    """
    # Not larger than a link may be.
    vertices = vertices * scale
    if not len(vertices) or not len(triangles) or not np.isfinite(vertices).all():
        raise RobotError(field, name, "is empty, or has vertices that are not finite")
    extent = float(np.max(np.ptp(vertices, axis=0)))
    if extent > MAX_EXTENT:
        raise RobotError(
            field,
            name,
            f"is {extent:.0f} m long; if it is in millimetres, give scale 0.001 0.001 0.001",
        )
    # A polytope where it is convex, else its triangles.
    corners = vertices[triangles]
    if not np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any():
        raise RobotError(field, name, "has no surface; check its scale")
    part = hull_if_convex(corners)
    return triangle_geometry(vertices, triangles) if part is None else convex_geometry(part)


def convex_shape(points: Array) -> coal.Convex:
    """The hull of points (n, 3) as a coal shape.

    Raises:
        QhullError: they have no volume.
    """
    return convex_geometry(polytope_of(points))


def convex_geometry(part: ConvexPart) -> coal.Convex:
    """A polytope as a coal shape."""
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    vertices.extend(list(part.vertices))
    triangles.extend([coal.Triangle(*each) for each in part.triangles.tolist()])
    shape = coal.Convex(vertices, triangles)
    shape.computeLocalAABB()
    return shape


def triangle_geometry(vertices: Array, triangles: npt.NDArray[np.int_]) -> coal.BVHModelOBBRSS:
    """Triangles (t, 3) of vertices (n, 3) as a coal surface."""
    mesh = coal.BVHModelOBBRSS()
    # A tree of boxes over all triangles.
    mesh.beginModel(len(triangles), len(vertices))
    mesh.addVertices(np.ascontiguousarray(vertices, np.float64))
    mesh.addTriangles(np.ascontiguousarray(triangles, np.int32))
    mesh.endModel()
    mesh.computeLocalAABB()
    return mesh
