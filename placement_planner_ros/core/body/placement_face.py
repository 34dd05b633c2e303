"""F, the faces that the object can rest on, their vertices v(f) and frames fT_o."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull

from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.body.stable_poses import (
    GRAVITY,
    ROUNDING_M,
    TIPPING_ENERGY,
    StablePose,
    stable_poses,
)
from placement_planner_ros.core.body.tipping import Index, Mask, Tipping
from placement_planner_ros.core.types import Array, frozen_array

CONTACT_SHARE, CONTACT_HEIGHT_SHARE = 0.2, 0.01
"""Shares of the flatness, and of the height of the centre of mass, up to which a vertex above the
plane is one that touches it."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacementFace:
    """f: a plane the object can rest on.

    Attributes:
        vertices: (k, 3) v(f) in the object frame, on the plane, in boundary order, convex.
        reference: (3,) the point of the plane that says where the object stands: the first of the
            vertices, unless it is chosen otherwise (`over`).
        normal: (3,) unit, outward: down when the object rests on f.
        T_face_object: fT_o; T(R_z(θ), (x, y, z_r)) · fT_o is a pose of S^(r, f), with the
            reference point at (x, y, z_r).
        area: of the polygon, m².
        rolls: whether the object could roll from there.
    """

    vertices: Array
    reference: Array
    normal: Array
    T_face_object: pin.SE3
    area: float
    rolls: bool = False

    def over(self, point: Array) -> PlacementFace:
        """The same face, with the foot of a point (3,) of the object as its reference point."""
        foot = point + ((self.vertices[0] - point) @ self.normal) * self.normal
        rotation = self.T_face_object.rotation
        return replace(
            self,
            reference=frozen_array(foot),
            T_face_object=pin.SE3(rotation, -rotation @ foot),
        )


def placement_faces(
    points: Array, center: Array, settings: BodySettings
) -> tuple[PlacementFace, ...]:
    """Planes on which an object of these points (n, 3) rests, larger first; rolling ones too.

    Args:
        center: (3,) its centre of mass, inside their hull.
    """
    tipping = Tipping.of(points, center)
    found = stable_poses(tipping, settings.flatness, settings.merge_angle)
    faces = [_face_of(tipping, rest, center, settings) for rest in found]
    faces.sort(key=lambda made: (-made[0].area, -made[1]))
    return tuple(face for face, _ in faces)


def offered_faces(
    faces: tuple[PlacementFace, ...], settings: BodySettings, warnings: list[str]
) -> tuple[tuple[PlacementFace, ...], int]:
    """The faces that a placement may use, and how many were left out; warns where there is none."""
    kept = tuple(face for face in faces if settings.allow_rolling or not face.rolls)
    if not kept:
        warnings.append("the object has no face to stand on")
    return kept, len(faces) - len(kept)


def _face_of(
    tipping: Tipping, rest: StablePose, center: Array, settings: BodySettings
) -> tuple[PlacementFace, float]:
    """The face of a rest, and the area that touches, m².

    v(f) is what lies within the flatness of the plane. Where so little touches that the body may
    come to rock on what is around, that belongs to v(f), too.
    """
    # The plane, and how far vertices are above it.
    normal = tipping.normals[rest.facet]
    offset = float((tipping.vertices @ normal).max())  # no vertex is cut off by rounding
    height = float(offset - normal @ center)
    depths = offset - tipping.vertices @ normal
    axes = _plane_axes(normal)
    # What touches, and what is within the flatness, or as far as it rocks.
    touching = min(CONTACT_SHARE * settings.flatness, CONTACT_HEIGHT_SHARE * height)
    touches = depths <= max(touching, ROUNDING_M)
    touches[tipping.facets[rest.facet]] = True
    _, contact = _convex_polygon((tipping.vertices[touches] - center) @ axes.T)
    bears = touches | (depths <= settings.flatness)
    if not rest.rolls and not _holds_firmly(contact, height):
        bears |= _rocks_on(tipping, rest)
    # v(f): the corners of that, in the plane, and the frame along its longest edge.
    near = tipping.vertices[bears]
    near = near + (offset - near @ normal)[:, None] * normal  # onto the plane
    order, outline = _convex_polygon(near @ axes.T)
    vertices = near[_thinned_corners(order, outline, settings.max_face_vertices)]
    rotation = _axes_along(vertices, normal)
    face = PlacementFace(
        vertices=frozen_array(vertices),
        reference=frozen_array(vertices[0]),
        normal=frozen_array(normal),
        T_face_object=pin.SE3(rotation, -rotation @ vertices[0]),
        area=_polygon_area(outline),
        rolls=rest.rolls,
    )
    return face, _polygon_area(contact)


def _thinned_corners(order: Index, outline: Array, most: int) -> Index:
    """Of indices (k,) of corners (k, 2) at most so many, extreme in evenly spread directions."""
    if len(order) <= most:
        return order
    angles = 2.0 * np.pi * np.arange(most) / most
    directions = np.stack((np.cos(angles), np.sin(angles)))
    return np.asarray(order[np.unique((outline @ directions).argmax(axis=0))])


def _axes_along(vertices: Array, normal: Array) -> Array:
    """(3, 3) rows: x along the longest edge of the polygon, z against the normal."""
    # The longest edge, without what leaves the plane.
    edges = np.roll(vertices, -1, axis=0) - vertices
    along = edges[np.argmax(np.linalg.norm(edges, axis=1))]
    along = along - (along @ normal) * normal
    along /= np.linalg.norm(along)
    return np.stack((along, np.cross(-normal, along), -normal))


def _holds_firmly(outline: Array, height: float) -> bool:
    """Whether tipping over each edge of the outline about the centre takes enough energy."""
    distance = float(_edge_distances(outline).min())
    return distance > 0.0 and GRAVITY * (np.hypot(height, distance) - height) >= TIPPING_ENERGY


def _rocks_on(tipping: Tipping, rest: StablePose) -> Mask:
    """(n,) vertices of the facets that the body gets to with less than that energy."""
    highest = float(tipping.heights[rest.facet]) + TIPPING_ENERGY / GRAVITY
    facets = tipping.around(rest.facet, -np.inf, highest)
    found = np.zeros(len(tipping.vertices), np.bool_)
    found[tipping.facets[facets]] = True
    return found


def _plane_axes(normal: Array) -> Array:
    """(2, 3) orthonormal axes of the plane."""
    # Across the axis that the normal is least along.
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first)
    return np.stack((first, np.cross(normal, first)))


def _convex_polygon(points: Array) -> tuple[Index, Array]:
    """Indices (k,) and corners (k, 2) of the hull of (n, 2) points, counter-clockwise."""
    order = ConvexHull(points).vertices.astype(np.int64)
    return order, points[order]


def _edge_distances(polygon: Array) -> Array:
    """(k,) distance from the origin to each edge's line, negative outside."""
    edges = np.roll(polygon, -1, axis=0) - polygon
    across = polygon[:, 0] * edges[:, 1] - polygon[:, 1] * edges[:, 0]
    return np.asarray(across / np.linalg.norm(edges, axis=1))


def _polygon_area(polygon: Array) -> float:
    following = np.roll(polygon, -1, axis=0)
    return 0.5 * float((polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]).sum())
