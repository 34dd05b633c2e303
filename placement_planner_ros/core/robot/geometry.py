"""Collision geometry of a URDF as coal shapes: primitives as they are, convex meshes as convex
polytopes, all other meshes as exact triangle soups."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
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

PackageDirs = Mapping[str, str | Path] | Sequence[str | Path]
"""Package name -> its share folder, or folders that hold packages or relative mesh paths."""


def package_names(urdf_text: str) -> tuple[str, ...]:
    """Packages that `package://` URIs in a URDF refer to, sorted."""
    return tuple(sorted(set(re.findall(r"package://([^/\"'<>\s]+)", urdf_text))))


def build_geometry(
    root: ET.Element, model: pin.Model, package_dirs: PackageDirs
) -> tuple[pin.GeometryModel, tuple[str, ...]]:
    """All <collision> elements of a URDF.

    Returns:
        the geometry model without collision pairs, and the link of each of its objects.

    Raises:
        RobotError: a geometry is empty, not finite, of no size, in millimetres or not found.
    """
    geometry = pin.GeometryModel()
    links: list[str] = []
    loaded: dict[tuple[Path, tuple[float, ...]], coal.CollisionGeometry] = {}
    for link in root.findall("link"):
        name = str(link.get("name"))
        frame_id = model.getFrameId(name, pin.FrameType.BODY)
        frame = model.frames[frame_id]
        for index, element in enumerate(link.findall("collision")):
            field = f"link {name}, collision {index}"
            shape = _read_shape(element, field, package_dirs, loaded)
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


def _read_shape(
    collision: ET.Element,
    field: str,
    package_dirs: PackageDirs,
    loaded: dict[tuple[Path, tuple[float, ...]], coal.CollisionGeometry],
) -> coal.CollisionGeometry:
    geometry = collision.find("geometry")
    shapes = [] if geometry is None else list(geometry)
    if len(shapes) != 1:
        raise RobotError(field, [s.tag for s in shapes], "give it exactly one shape")
    shape = shapes[0]
    if shape.tag == "mesh":
        scale = read_floats(shape.get("scale", "1 1 1"), 3, f"{field}: scale")
        path = _resolve(shape.get("filename", ""), field, package_dirs)
        key = (path, tuple(scale))
        if key not in loaded:
            loaded[key] = load_mesh(path, scale, field)
        return loaded[key]
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


def _resolve(uri: str, field: str, package_dirs: PackageDirs) -> Path:
    """The file a mesh URI names: package://, file://, absolute, or relative to a package folder."""
    parts = urlparse(uri)
    if isinstance(package_dirs, Mapping):
        folders = [Path(folder) for folder in package_dirs.values()]
        packages = [Path(package_dirs[parts.netloc])] if parts.netloc in package_dirs else []
    else:
        folders = [Path(folder) for folder in package_dirs]
        packages = [folder / parts.netloc for folder in folders]
        packages += [folder for folder in folders if folder.name == parts.netloc]
    if parts.scheme == "package":
        candidates = [package / unquote(parts.path).lstrip("/") for package in packages]
    elif parts.scheme == "file":
        candidates = [Path(unquote(parts.path))]
    elif parts.scheme:
        raise RobotError(f"{field}: mesh", uri, "use package://, file:// or a path")
    else:
        candidates = [folder / uri for folder in (Path(), *folders)]
    for candidate in candidates:
        if candidate.is_file():
            return candidate.resolve()
    tried = ", ".join(str(c) for c in candidates) or "no folder of that package is known"
    raise RobotError(f"{field}: mesh", uri, f"no such file; tried {tried}")


def load_mesh(path: Path, scale: Array, field: str) -> coal.CollisionGeometry:
    """A mesh file scaled by (3,) `scale`: a coal.Convex where it is convex, else a BVH.

    Raises:
        RobotError: unreadable, empty, not finite, degenerate or larger than `MAX_EXTENT`.
    """
    try:
        mesh = coal.MeshLoader().load(str(path), np.ones(3))
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split("message:")[-1].split("Hint")[0].split())
        raise RobotError(f"{field}: mesh", str(path), f"cannot be read: {reason}") from error
    vertices = np.array(mesh.vertices(), dtype=np.float64).reshape(-1, 3) * scale
    triangles = np.array(
        [[t[0], t[1], t[2]] for t in (mesh.tri_indices(i) for i in range(mesh.num_tris))]
    ).reshape(-1, 3)
    if not len(vertices) or not len(triangles):
        raise RobotError(f"{field}: mesh", str(path), "is empty")
    if not np.isfinite(vertices).all():
        raise RobotError(f"{field}: mesh", str(path), "has vertices that are not finite")
    extent = float(np.max(np.ptp(vertices, axis=0)))
    if extent > MAX_EXTENT:
        raise RobotError(
            f"{field}: mesh",
            str(path),
            f"is {extent:.0f} m long; if it is in millimetres, give scale 0.001 0.001 0.001",
        )
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * float(np.linalg.norm(normals, axis=1).sum())
    if not area > 0.0:
        raise RobotError(f"{field}: mesh", str(path), "has no surface; check its scale")
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
