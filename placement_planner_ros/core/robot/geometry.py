"""Collision geometry of a URDF as coal shapes: primitives as they are, convex meshes as convex
polytopes, all other meshes as exact triangle soups."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol
from urllib.parse import unquote, urlparse

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.description import read_floats, read_origin
from placement_planner_ros.core.types import Array

CONVEX_TOLERANCE = 1e-3
"""m (and 1 % of the mesh's size): a mesh whose triangles lie this close beneath the facets of its
hull counts as convex; its hull, which stands in for it, is nowhere further outside."""

MAX_EXTENT = 10.0
"""m; a mesh larger than this is taken to be in millimetres."""

PRIMITIVES = {
    "box": (coal.Box, {"size": 3}),
    "sphere": (coal.Sphere, {"radius": 1}),
    "cylinder": (coal.Cylinder, {"radius": 1, "length": 1}),
    "capsule": (coal.Capsule, {"radius": 1, "length": 1}),
}
"""URDF shape -> coal shape, and its attributes with how many numbers each holds."""

MAX_TRIANGLES = 100_000
"""Triangles that a collision mesh may have."""

MAX_ALL_TRIANGLES = 300_000
"""... and that all meshes of a robot may have together, each file counted once."""

MAX_SHAPES = 1000
"""Collision shapes that a robot may have."""

_MOST_COMPARED = 100_000_000
"""Facets of a hull times triangles of its mesh; with more, the mesh is taken as it is."""

PackageDirs = Mapping[str, str | Path] | Sequence[str | Path]
"""Package name -> its share folder, or folders that hold packages or relative mesh paths."""

Triangles = npt.NDArray[np.int64]


class MeshFiles(Protocol):
    """Finds and reads the meshes that a URDF names."""

    def find(self, uri: str) -> Path:
        """The file that a mesh's URI names; an OSError says why there is none."""
        ...

    def read(self, path: Path) -> tuple[Array, Triangles]:
        """Vertices (n, 3) and triangles (t, 3); any Exception says why there are none."""
        ...


def package_names(urdf_text: str) -> tuple[str, ...]:
    """Packages that `package://` URIs in a URDF refer to, sorted."""
    return tuple(sorted(set(re.findall(r"package://([^/\"'<>\s]+)", urdf_text))))


def build_geometry(
    root: ET.Element, model: pin.Model, files: PackageDirs | MeshFiles
) -> tuple[pin.GeometryModel, tuple[str, ...]]:
    """All <collision> elements of a URDF.

    Returns:
        the geometry model without collision pairs, and the link of each of its objects.

    Raises:
        RobotError: a geometry is empty, not finite, of no size, in millimetres, too large or not
            found.
    """
    count = sum(1 for _ in root.iterfind("link/collision"))
    if count > MAX_SHAPES:
        raise RobotError(
            "robot_description",
            f"{count} collision shapes",
            f"is more than a robot may have, {MAX_SHAPES}",
        )
    meshes = _Meshes(_Folders(files) if isinstance(files, (Mapping, Sequence)) else files)
    geometry = pin.GeometryModel()
    links: list[str] = []
    for link in root.findall("link"):
        name = str(link.get("name"))
        frame_id = model.getFrameId(name, pin.FrameType.BODY)
        frame = model.frames[frame_id]
        for index, element in enumerate(link.findall("collision")):
            field = f"link {name}, collision {index}"
            shape = _read_shape(element, field, meshes)
            T_link_shape = read_origin(element, field)
            geometry.addGeometryObject(
                pin.GeometryObject(
                    f"{name}_{index}",
                    frame.parentJoint,
                    frame_id,
                    frame.placement * T_link_shape,
                    shape,
                )
            )
            links.append(name)
    return geometry, tuple(links)


def _read_shape(collision: ET.Element, field: str, meshes: _Meshes) -> coal.CollisionGeometry:
    geometry = collision.find("geometry")
    shapes = [] if geometry is None else list(geometry)
    if len(shapes) != 1:
        raise RobotError(field, [s.tag for s in shapes], "give it exactly one shape")
    shape = shapes[0]
    if shape.tag == "mesh":
        scale = read_floats(shape.get("scale", "1 1 1"), 3, f"{field}: scale")
        return meshes.shape(shape.get("filename", ""), scale, field)
    if shape.tag not in PRIMITIVES:
        raise RobotError(field, shape.tag, f"use mesh or one of {list(PRIMITIVES)}")
    make, counts = PRIMITIVES[shape.tag]
    sizes = [read_floats(shape.get(a, ""), n, f"{field}: {a}") for a, n in counts.items()]
    values = np.concatenate(sizes)
    if not (values > 0.0).all():
        raise RobotError(f"{field}: {shape.tag}", values.tolist(), "every size must be positive")
    primitive = make(*values.tolist())
    primitive.computeLocalAABB()
    return primitive


class _Folders:
    """Mesh files below package folders."""

    def __init__(self, package_dirs: PackageDirs) -> None:
        self._package_dirs = package_dirs

    def find(self, uri: str) -> Path:
        """The file a mesh URI names: package://, file://, absolute, or relative to a folder."""
        parts = urlparse(uri)
        if isinstance(self._package_dirs, Mapping):
            folders = [Path(folder) for folder in self._package_dirs.values()]
            known = parts.netloc in self._package_dirs
            packages = [Path(self._package_dirs[parts.netloc])] if known else []
        else:
            folders = [Path(folder) for folder in self._package_dirs]
            packages = [folder / parts.netloc for folder in folders]
            packages += [folder for folder in folders if folder.name == parts.netloc]
        if parts.scheme == "package":
            candidates = [package / unquote(parts.path).lstrip("/") for package in packages]
        elif parts.scheme == "file":
            candidates = [Path(unquote(parts.path))]
        elif parts.scheme:
            raise FileNotFoundError("use package://, file:// or a path")
        else:
            candidates = [folder / uri for folder in (Path(), *folders)]
        for candidate in candidates:
            if candidate.is_file():
                return candidate.resolve()
        tried = ", ".join(str(c) for c in candidates) or "no folder of that package is known"
        raise FileNotFoundError(f"no such file; tried {tried}")

    def read(self, path: Path) -> tuple[Array, Triangles]:
        """Vertices and triangles of a file."""
        return read_mesh(path)


class _Meshes:
    """The meshes of one robot as shapes, each read once."""

    def __init__(self, files: MeshFiles) -> None:
        self._files = files
        self._read: dict[Path, tuple[Array, Triangles]] = {}
        self._shapes: dict[tuple[Path, tuple[float, ...]], coal.CollisionGeometry] = {}
        self._triangles = 0

    def shape(self, uri: str, scale: Array, field: str) -> coal.CollisionGeometry:
        """The mesh a URI names, scaled by (3,) `scale`.

        Raises:
            RobotError: not found, unreadable or unusable.
        """
        try:
            path = self._files.find(uri)
        except (OSError, ValueError) as error:  # ValueError: no URI, or a null in a path
            raise RobotError(f"{field}: mesh", uri, str(error)) from error
        key = (path, tuple(scale))
        if key not in self._shapes:
            if path not in self._read:
                self._read[path] = self._arrays(path, field)
            self._shapes[key] = mesh_shape(*self._read[path], scale, f"{field}: mesh", str(path))
        return self._shapes[key]

    def _arrays(self, path: Path, field: str) -> tuple[Array, Triangles]:
        try:
            vertices, triangles = self._files.read(path)
        except RobotError:
            raise
        except Exception as error:  # whatever loaders raise at what they are given
            reason = str(error) or type(error).__name__
            raise RobotError(f"{field}: mesh", str(path), f"cannot be read: {reason}") from error
        self._triangles += len(triangles)
        if len(triangles) > MAX_TRIANGLES or self._triangles > MAX_ALL_TRIANGLES:
            raise RobotError(
                f"{field}: mesh",
                str(path),
                f"has {len(triangles)} triangles; a mesh may have {MAX_TRIANGLES}, all meshes of "
                f"a robot together {MAX_ALL_TRIANGLES}: use simpler collision meshes",
            )
        return vertices, triangles


def read_mesh(path: Path) -> tuple[Array, Triangles]:
    """Vertices (n, 3) and triangles (t, 3) of a mesh file, in its unit.

    Raises:
        ValueError: unreadable; the message says why.
    """
    try:
        mesh = coal.MeshLoader().load(str(path), np.ones(3))
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split("message:")[-1].split("Hint")[0].split())
        raise ValueError(reason) from error
    vertices = np.array(mesh.vertices(), dtype=np.float64).reshape(-1, 3)
    rows = (mesh.tri_indices(i) for i in range(mesh.num_tris))
    triangles = np.array([[t[0], t[1], t[2]] for t in rows], dtype=np.int64)
    return vertices, triangles.reshape(-1, 3)


def mesh_shape(
    vertices: Array, triangles: Triangles, scale: Array, field: str, name: str
) -> coal.CollisionGeometry:
    """A mesh scaled by (3,) `scale`: a coal.Convex where it is convex, else a BVH.

    Raises:
        RobotError: empty, not finite, degenerate or larger than `MAX_EXTENT`.
    """
    vertices = vertices * scale
    if not len(vertices) or not len(triangles):
        raise RobotError(field, name, "is empty")
    bad = int((~np.isfinite(vertices).all(axis=1)).sum())
    if bad:
        raise RobotError(field, name, f"has {bad} vertices that are not finite")
    extent = float(np.max(np.ptp(vertices, axis=0)))
    if extent > MAX_EXTENT:
        raise RobotError(
            field,
            name,
            f"is {extent:.0f} m long; if it is in millimetres, give scale 0.001 0.001 0.001",
        )
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * float(np.linalg.norm(normals, axis=1).sum())
    if not area > 0.0:
        raise RobotError(field, name, "has no surface; check its scale")
    hull = _hull_if_convex(corners, area, extent)
    return _bvh(vertices, triangles) if hull is None else convex(hull)


def _hull_if_convex(corners: Array, area: float, extent: float) -> ConvexHull | None:
    """The hull, where every triangle lies on one of its planes and together they cover it."""
    try:
        hull = ConvexHull(corners.reshape(-1, 3))
    except QhullError:  # flat
        return None
    if abs(area - hull.area) > 1e-3 * hull.area:
        return None
    planes = np.unique(hull.equations.round(9), axis=0)
    if len(planes) * len(corners) > _MOST_COMPARED:
        return None
    tolerance = min(CONVEX_TOLERANCE, 0.01 * extent)
    chunk = max(1, 1_000_000 // (3 * len(planes)))
    for start in range(0, len(corners), chunk):
        part = corners[start : start + chunk]
        depth = -(part @ planes[:, :3].T + planes[:, 3])  # (triangles, corners, planes)
        if depth.max(axis=1).min(axis=1).max() > tolerance:
            return None
    return hull


def convex(hull: ConvexHull) -> coal.Convex:
    """A scipy hull as a coal shape, triangles turned outward."""
    row = np.full(len(hull.points), -1)
    row[hull.vertices] = np.arange(len(hull.vertices))
    corners = hull.points[hull.simplices]
    turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = (turned * hull.equations[:, :3]).sum(axis=1) < 0.0
    simplices = np.where(inward[:, None], hull.simplices[:, [0, 2, 1]], hull.simplices)
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    points.extend(list(hull.points[hull.vertices]))
    triangles.extend([coal.Triangle(*(int(row[v]) for v in s)) for s in simplices])
    shape = coal.Convex(points, triangles)
    shape.computeLocalAABB()
    return shape


def _bvh(vertices: Array, triangles: npt.NDArray[np.int_]) -> coal.BVHModelOBBRSS:
    mesh = coal.BVHModelOBBRSS()
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    points.extend(list(vertices))
    faces.extend([coal.Triangle(*map(int, t)) for t in triangles])
    mesh.beginModel(len(triangles), len(vertices))
    mesh.addSubModel(points, faces)
    mesh.endModel()
    mesh.computeLocalAABB()
    return mesh
