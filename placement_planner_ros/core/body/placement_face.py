"""F, the faces that the object can rest on, their vertices v(f) and frames fT_o."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.body.convex_part import ConvexPart
from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.types import Array, frozen_array


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


def placement_faces(
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
