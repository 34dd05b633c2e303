"""The grasped object: convex parts, placement faces F, v(f), fT_o, and the volume points B_o."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.types import Array, frozen_array

Triangles = npt.NDArray[np.int64]

_SHEET = 0.0005
"""Parts without thickness are thickened by this to every side, metres."""
_THINNEST = 1e-4
"""Objects thinner than this have no volume to plan with, metres."""


@dataclass(frozen=True, slots=True)
class BodySettings(Settings):
    """How a mesh becomes a body.

    Attributes:
        merge_angle: hull facets within this angle of a placement face are not faces of their own.
        flatness: vertices within this of a face's plane belong to v(f); keep it below the
            contact tolerance.
        contact_flatness: ... and within this they bear the object, for the two limits below;
            at most a hundredth of the height of the centre of mass, so that round sides do not
            pass for flat ones.
        center_margin: how far inside a face the projected centre of mass must lie; at most
            a quarter of the object's smallest extent.
        tipping_angle: the least tilt about an edge of the face that makes the object fall over
            must be larger; twice that where the next facet of the hull is so close in
            direction (`rolling_angle`) that the object would roll on.
        max_face_vertices: v(f) is thinned to so many, extreme in evenly spread directions.
        voxel_size: spacing of B_o.
        max_volume_points: B_o is made coarser above that.
        max_extent: larger objects are taken for ones in millimetres.
    """

    merge_angle: float = setting(0.18, "(0, inf)", "rad")
    flatness: float = setting(0.001, "(0, inf)", "m")
    contact_flatness: float = setting(0.0003, "(0, inf)", "m")
    center_margin: float = setting(0.01, "[0, inf)", "m")
    tipping_angle: float = setting(0.15, "[0, inf)", "rad")
    rolling_angle: float = setting(0.5, "[0, inf)", "rad")
    max_face_vertices: int = setting(16, "[4, inf)")
    voxel_size: float = setting(0.005, "(0, inf)", "m")
    max_volume_points: int = setting(20_000, "[1, inf)")
    max_extent: float = setting(2.0, "(0, inf)", "m")


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPart:
    """A convex polytope in the object frame.

    Attributes:
        vertices: (m, 3), metres.
        triangles: (t, 3) int, counter-clockwise from outside.
        normals, offsets: (p, 3), (p,), the points with normals @ x <= offsets; coplanar triangles
            share one.
    """

    vertices: Array
    triangles: Triangles
    normals: Array
    offsets: Array


@dataclass(frozen=True, slots=True, eq=False)
class PlacementFace:
    """f: a plane the object can rest on.

    Attributes:
        vertices: (k, 3) v(f) in the object frame, on the plane, in boundary order, convex; the
            first is the reference vertex.
        normal: (3,) unit, outward: down when the object rests on f.
        T_face_object: fT_o; T(R_z(θ), (x, y, z_r)) · fT_o is a pose of S^(r, f), with the
            reference vertex at (x, y, z_r).
        area: of the polygon, m².
    """

    vertices: Array
    normal: Array
    T_face_object: pin.SE3
    area: float


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """The grasped object in its own frame.

    Attributes:
        parts: convex parts whose union holds the object.
        faces: F, larger first.
        volume_points: (n, 3) B_o, voxel centres inside.
        center_of_mass: (3,).
        vertices, triangles: (m, 3), (t, 3) the mesh.
        warnings: what was not as expected, in words.
    """

    parts: tuple[ConvexPart, ...]
    faces: tuple[PlacementFace, ...]
    volume_points: Array
    center_of_mass: Array
    vertices: Array
    triangles: Triangles
    warnings: tuple[str, ...]

    @classmethod
    def from_mesh(
        cls,
        vertices: npt.ArrayLike,
        triangles: npt.ArrayLike,
        center_of_mass: npt.ArrayLike | None = None,
        scale: float = 1.0,
        settings: BodySettings | None = None,
    ) -> Body:
        """Prepare the object for planning.

        Each connected piece of the mesh becomes a convex part: itself where it is convex, else its
        hull, which is on the safe side. Where a piece is not closed, B_o and the centre of mass
        are those of the hull of all.

        Args:
            vertices: (m, 3).
            triangles: (t, 3) indices of vertices.
            center_of_mass: (3,) in the mesh's frame and units; of uniform density unless given.
            scale: metres per unit of the mesh.

        Raises:
            ObjectError: empty, not finite, bad indices, without volume, implausibly large or
                small, or a centre of mass outside the hull.
        """
        settings = settings or BodySettings()
        points, faces = _checked(vertices, triangles, scale, settings.max_extent)
        hull = _hull(points[np.unique(faces)])
        warnings: list[str] = []
        pieces = _pieces(points, faces)
        parts = tuple(_part(piece, number, warnings) for number, piece in enumerate(pieces))
        closed = all(piece.is_watertight for piece in pieces)
        solids = pieces
        if not closed:
            warnings.append("the mesh is not closed: volume and centre of mass are its hull's")
            solids = [trimesh.Trimesh(hull.vertices, hull.triangles, process=False)]
        surface = np.concatenate([np.asarray(solid.triangles) for solid in solids])
        volume_points = _volume_points(surface, hull, settings, warnings)
        if center_of_mass is not None:
            center = _checked_center(center_of_mass, scale)
        elif len(solids) == 1:
            center = np.asarray(solids[0].center_mass)
        else:  # pieces may overlap: count what they share once
            center = volume_points.mean(axis=0)
        outside = float(np.max(hull.normals @ center - hull.offsets))
        if outside > 1e-6:
            raise ObjectError(
                "object.center_of_mass",
                center.tolist(),
                f"lies {outside:.4g} m outside the object's hull; give it in the object's frame",
            )
        found = _placement_faces(hull, center, settings)
        if not found:
            warnings.append("the object has no face to stand on")
        return cls(
            parts=parts,
            faces=found,
            volume_points=frozen_array(volume_points),
            center_of_mass=frozen_array(center),
            vertices=frozen_array(points),
            triangles=_read_only(faces),
            warnings=tuple(warnings),
        )


def _read_only(triangles: npt.ArrayLike) -> Triangles:
    array = np.array(triangles, dtype=np.int64)
    array.setflags(write=False)
    return array


def _checked(
    vertices: npt.ArrayLike, triangles: npt.ArrayLike, scale: float, max_extent: float
) -> tuple[Array, Triangles]:
    if not (math.isfinite(scale) and scale > 0.0):
        raise ObjectError("object.scale", scale, "give a finite number above 0")
    try:
        points = np.array(vertices, dtype=np.float64)
        faces = np.array(triangles)
    except (TypeError, ValueError) as error:
        raise ObjectError("object", "mesh", "give numbers of shape (m, 3) and (t, 3)") from error
    if points.size == 0 or faces.size == 0:
        raise ObjectError("object", f"{points.size // 3} vertices", "the mesh is empty")
    if points.ndim != 2 or points.shape[1] != 3:
        raise ObjectError("object.vertices", points.shape, "give shape (m, 3)")
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise ObjectError("object.triangles", faces.shape, "give shape (t, 3)")
    if not np.issubdtype(faces.dtype, np.integer):
        raise ObjectError("object.triangles", faces.dtype, "give integers")
    if faces.min() < 0 or faces.max() >= len(points):
        bad = int(faces.min()) if faces.min() < 0 else int(faces.max())
        raise ObjectError("object.triangles", bad, f"is no index of one of {len(points)} vertices")
    used = points[np.unique(faces)]
    if not np.isfinite(used).all():
        raise ObjectError("object.vertices", "NaN or infinite", "give finite numbers")
    extents = (used.max(axis=0) - used.min(axis=0)) * scale
    if extents.max() > max_extent:
        raise ObjectError(
            "object",
            f"{extents.max():.4g} m across",
            f"is larger than {max_extent} m; a mesh in millimetres needs object.scale 0.001",
        )
    if extents.max() < 10.0 * _THINNEST:
        raise ObjectError(
            "object", f"{extents.max():.4g} m across", "is too small; check object.scale"
        )
    return points * scale, faces.astype(np.int64)


def _checked_center(center_of_mass: npt.ArrayLike, scale: float) -> Array:
    try:
        center = np.array(center_of_mass, dtype=np.float64) * scale
    except (TypeError, ValueError) as error:
        raise ObjectError("object.center_of_mass", center_of_mass, "give three numbers") from error
    if center.shape != (3,) or not np.isfinite(center).all():
        raise ObjectError("object.center_of_mass", center.tolist(), "give three finite numbers")
    return center


def _polytope(points: Array) -> ConvexPart:
    """The convex hull of (n, 3) points.

    Raises:
        QhullError: they have no volume.
    """
    hull = ConvexHull(points)
    # coplanar triangles come with equal equations, up to rounding
    normals = hull.equations[:, :3]
    used, index = np.unique(hull.simplices, return_inverse=True)
    triangles = index.reshape(-1, 3)
    vertices = hull.points[used]
    corners = vertices[triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", facing, normals) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    _, first = np.unique(np.round(hull.equations, 7), axis=0, return_index=True)
    planes = normals[np.sort(first)]
    offsets = np.max(vertices @ planes.T, axis=0)  # no vertex is cut off by rounding
    return ConvexPart(
        frozen_array(vertices), _read_only(triangles), frozen_array(planes), frozen_array(offsets)
    )


def _hull(vertices: Array) -> ConvexPart:
    """The hull of the whole object.

    Raises:
        ObjectError: it has no volume.
    """
    flat = ObjectError("object", "flat mesh", "has no volume; give it a thickness")
    spread = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)[2]
    if np.min(np.ptp(vertices @ spread.T, axis=0)) < _THINNEST:
        raise flat
    try:
        return _polytope(vertices)
    except QhullError as error:
        raise flat from error


def _pieces(points: Array, triangles: Triangles) -> list[trimesh.Trimesh]:
    """The connected pieces of the mesh, facing outward where closed.

    Pieces that share no vertices are told apart even where they touch. Only what is not closed
    that way (every triangle with vertices of its own, as in STL files) has equal vertices merged.
    """
    found = _connected(points, triangles)
    closed = [piece for piece in found if piece.is_watertight]
    left = [piece for piece in found if not piece.is_watertight]
    if left:
        corners = np.concatenate([piece.triangles.reshape(-1, 3) for piece in left])
        merged = trimesh.Trimesh(
            corners, np.arange(len(corners)).reshape(-1, 3), process=False, validate=False
        )
        merged.merge_vertices()
        merged.update_faces(merged.nondegenerate_faces())
        closed += _connected(np.asarray(merged.vertices), np.asarray(merged.faces))
    for piece in closed:
        if piece.is_watertight and piece.volume < 0.0:
            piece.invert()
    return closed


def _connected(points: Array, triangles: Triangles) -> list[trimesh.Trimesh]:
    """The pieces of the mesh whose triangles share vertices."""
    graph = coo_matrix(
        (
            np.ones(2 * len(triangles), dtype=np.int8),
            (triangles[:, [0, 0]].ravel(), triangles[:, [1, 2]].ravel()),
        ),
        shape=(len(points), len(points)),
    )
    label = connected_components(graph, directed=False)[1][triangles[:, 0]]
    pieces = []
    for number in np.unique(label):
        piece = trimesh.Trimesh(points, triangles[label == number], process=False)
        piece.remove_unreferenced_vertices()
        pieces.append(piece)
    return pieces


def _part(piece: trimesh.Trimesh, number: int, warnings: list[str]) -> ConvexPart:
    """A connected piece's hull, with a warning where that is more than the piece."""
    vertices = np.asarray(piece.vertices)
    try:
        part = _polytope(vertices)
    except QhullError:
        warnings.append(f"part {number} has no thickness: taken as {2 * _SHEET * 1e3:g} mm thick")
        corners = _SHEET * np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
        return _polytope((vertices[:, None] + corners).reshape(-1, 3))
    if piece.is_watertight:
        filled = trimesh.Trimesh(part.vertices, part.triangles, process=False).volume
        if filled - piece.volume > 0.01 * filled:
            warnings.append(f"part {number} is not convex: its hull stands for it")
    return part


def _volume_points(
    triangles: Array, hull: ConvexPart, settings: BodySettings, warnings: list[str]
) -> Array:
    """B_o: voxel centres inside the closed surface, the grid centred on the object's extents."""
    lower, upper = hull.vertices.min(axis=0), hull.vertices.max(axis=0)
    size = settings.voxel_size
    room = float(np.prod(upper - lower)) / size**3
    if room > 200.0 * settings.max_volume_points:  # far too fine to count first
        size *= (room / (200.0 * settings.max_volume_points)) ** (1.0 / 3.0)
    points = _voxel_centers(triangles, lower, upper, size)
    while len(points) > settings.max_volume_points:
        size *= max(1.02, (len(points) / settings.max_volume_points) ** (1.0 / 3.0))
        points = _voxel_centers(triangles, lower, upper, size)
    for _ in range(3):  # walls thinner than a voxel
        if len(points) >= 20:
            break
        size *= 0.5
        points = _voxel_centers(triangles, lower, upper, size)
    if len(points) == 0:
        warnings.append("its walls are too thin for volume points: those of the hull stand in")
        corners = np.asarray(hull.vertices[hull.triangles])
        points = _voxel_centers(corners, lower, upper, size)
    if len(points) == 0:
        raise ObjectError("object", "thin mesh", "holds no volume point; give it a thickness")
    return points


def _voxel_centers(triangles: Array, lower: Array, upper: Array, size: float) -> Array:
    count = np.ceil((upper - lower) / size - 1e-9).astype(np.int64)
    count = np.maximum(count, 1)
    start = 0.5 * (lower + upper) - 0.5 * (count - 1) * size
    return np.asarray(_inside(np.ascontiguousarray(triangles), start, count, size))


@kernel(nogil=True)
def _inside(triangles: Array, start: Array, count: npt.NDArray[np.int64], size: float) -> Array:
    """Grid points with a winding number other than 0, by the crossings of lines along z."""
    nx, ny, nz = count[0], count[1], count[2]
    winding = np.zeros((nx, ny, nz + 1), np.int32)  # differences along z
    # the lines pass a little beside the centres, off edges that meet there
    x0 = start[0] + 1.3e-7
    y0 = start[1] + 2.9e-7
    for t in range(len(triangles)):
        ax, ay, az = triangles[t, 0]
        bx, by, bz = triangles[t, 1]
        cx, cy, cz = triangles[t, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        i0 = max(math.ceil((min(ax, bx, cx) - x0) / size), 0)
        i1 = min(math.floor((max(ax, bx, cx) - x0) / size), nx - 1)
        j0 = max(math.ceil((min(ay, by, cy) - y0) / size), 0)
        j1 = min(math.floor((max(ay, by, cy) - y0) / size), ny - 1)
        for i in range(i0, i1 + 1):
            x = x0 + i * size
            for j in range(j0, j1 + 1):
                y = y0 + j * size
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                z = u * az + v * bz + w * cz
                # points above z have crossed this triangle from outside if it faces down
                k = min(max(math.ceil((z - start[2]) / size), 0), nz)
                winding[i, j, k] += 1 if area < 0.0 else -1
    points = np.empty((nx * ny * nz, 3))
    n = 0
    for i in range(nx):
        for j in range(ny):
            crossed = 0
            for k in range(nz):
                crossed += winding[i, j, k]
                if crossed != 0:
                    points[n, 0] = start[0] + i * size
                    points[n, 1] = start[1] + j * size
                    points[n, 2] = start[2] + k * size
                    n += 1
    return points[:n].copy()


def _placement_faces(
    hull: ConvexPart, center: Array, settings: BodySettings
) -> tuple[PlacementFace, ...]:
    """Supporting planes of the hull on which the object stands, larger first.

    Of hull planes within `merge_angle` of each other the one with the largest contact stands for
    all. Angles are taken to that plane alone, so that round sides are not merged around corners.
    """
    extents = np.ptp(hull.vertices, axis=0)
    margin = min(settings.center_margin, 0.25 * float(np.min(extents)))
    heights = hull.offsets - hull.normals @ center
    stable = []
    for normal, offset, height in zip(hull.normals, hull.offsets, heights, strict=True):
        bearing = min(settings.contact_flatness, 0.01 * float(height))
        reach = max(margin, height * math.tan(settings.tipping_angle))
        depths = offset - hull.vertices @ normal
        bears = depths <= max(bearing, 1e-7)
        # quick: some bearing vertex must be that far from the projected centre of mass
        away = hull.vertices[bears] - center
        beside = np.sqrt(np.maximum((away**2).sum(axis=1) - (away @ normal) ** 2, 0.0))
        if bears.sum() < 3 or beside.max() < reach:
            continue
        axes = _plane_axes(normal)
        polygon = _convex_polygon((hull.vertices[bears] - center) @ axes.T)
        if polygon is None:
            continue
        order, outline = polygon
        distances = _edge_distances(outline)
        edge = int(np.argmin(distances))
        if distances[edge] < reach - 1e-9:
            continue
        ends = hull.vertices[bears][[order[edge], order[(edge + 1) % len(order)]]]
        rolls = _next_facet(hull, normal, ends) < settings.rolling_angle
        if rolls and distances[edge] < height * math.tan(2.0 * settings.tipping_angle):
            continue
        stable.append((_polygon_area(outline), normal, offset))
    stable.sort(key=lambda face: -face[0])
    faces: list[PlacementFace] = []
    for _, normal, offset in stable:
        if all(face.normal @ normal < math.cos(settings.merge_angle) for face in faces):
            faces.append(_face(hull, normal, offset, settings))
    faces.sort(key=lambda face: -face.area)
    return tuple(faces)


def _face(hull: ConvexPart, normal: Array, offset: float, settings: BodySettings) -> PlacementFace:
    depths = offset - hull.vertices @ normal
    near = hull.vertices[depths <= settings.flatness]
    near = near + (offset - near @ normal)[:, None] * normal  # onto the plane
    axes = _plane_axes(normal)
    polygon = _convex_polygon(near @ axes.T)
    assert polygon is not None  # it holds the bearing polygon
    order, outline = polygon
    area = _polygon_area(outline)
    if len(order) > settings.max_face_vertices:
        angles = 2.0 * np.pi * np.arange(settings.max_face_vertices) / settings.max_face_vertices
        directions = np.stack((np.cos(angles), np.sin(angles)))
        order = order[np.unique((outline @ directions).argmax(axis=0))]
    vertices = near[order]
    # x along the longest edge, z against the normal
    edges = np.roll(vertices, -1, axis=0) - vertices
    along = edges[np.argmax(np.linalg.norm(edges, axis=1))]
    along = along - (along @ normal) * normal
    along /= np.linalg.norm(along)
    rotation = np.stack((along, np.cross(-normal, along), -normal))
    return PlacementFace(
        vertices=frozen_array(vertices),
        normal=frozen_array(normal),
        T_face_object=pin.SE3(rotation, -rotation @ vertices[0]),
        area=area,
    )


def _plane_axes(normal: Array) -> Array:
    """(2, 3) orthonormal axes of the plane."""
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first)
    return np.stack((first, np.cross(normal, first)))


def _convex_polygon(points: Array) -> tuple[npt.NDArray[np.int64], Array] | None:
    """Indices (k,) and corners (k, 2) of the hull of (n, 2) points, counter-clockwise."""
    try:
        order = ConvexHull(points).vertices.astype(np.int64)
    except QhullError:
        return None  # all on a line
    return order, points[order]


def _edge_distances(polygon: Array) -> Array:
    """(k,) distance from the origin to each edge's line, negative outside."""
    edges = np.roll(polygon, -1, axis=0) - polygon
    across = polygon[:, 0] * edges[:, 1] - polygon[:, 1] * edges[:, 0]
    return np.asarray(across / np.linalg.norm(edges, axis=1))


def _next_facet(hull: ConvexPart, normal: Array, ends: Array) -> float:
    """Angle to the nearest hull facet that leaves this plane at the edge between `ends`, rad."""
    touches = (np.abs(hull.normals @ ends.T - hull.offsets[:, None]) < 1e-6).all(axis=1)
    away = np.cross(ends[1] - ends[0], normal)  # out of the polygon, counter-clockwise from above
    touches &= hull.normals @ away > 1e-3 * np.linalg.norm(away)
    if not touches.any():
        return math.pi
    return float(np.arccos(np.clip(np.max(hull.normals[touches] @ normal), -1.0, 1.0)))


def _polygon_area(polygon: Array) -> float:
    following = np.roll(polygon, -1, axis=0)
    return 0.5 * float((polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]).sum())
