"""F, the faces that the object can rest on, their vertices v(f) and frames fT_o."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.linalg import null_space
from scipy.spatial import ConvexHull

from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.body.stable_poses import TIPPING_RISE_M, stable_poses
from placement_planner_ros.core.body.tipping import Tipping
from placement_planner_ros.core.types import Array, Index, frozen_array


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
            self, reference=frozen_array(foot), T_face_object=pin.SE3(rotation, -rotation @ foot)
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
    faces = [_face_of(tipping, facet, rolls, settings) for facet, rolls in found.items()]
    return tuple(sorted(faces, key=lambda face: -face.area))


def _face_of(tipping: Tipping, facet: int, rolls: bool, settings: BodySettings) -> PlacementFace:
    """The face of a facet to rest on: v(f) is what lies within the flatness of the plane, and
    where the body may come to rock on what is around."""
    # What touches the plane, which is beneath all vertices.
    normal = tipping.normals[facet]
    depths = (tipping.vertices @ normal).max() - tipping.vertices @ normal
    bears = depths <= settings.flatness
    if not rolls:
        highest = float(tipping.heights[facet]) + TIPPING_RISE_M
        bears[tipping.facets[tipping.around(facet, -np.inf, highest)]] = True
    # v(f): the corners of that, in the plane, and the frame along its longest edge.
    near = tipping.vertices[bears] + depths[bears, None] * normal
    outline = ConvexHull(near @ null_space(normal[None]))
    order = outline.vertices.astype(np.int64)
    if len(order) > settings.max_face_vertices:
        order = order[outermost_rows(outline.points[order], settings.max_face_vertices)]
    vertices = near[order]
    rotation = _axes_along(vertices, normal)
    return PlacementFace(
        vertices=frozen_array(vertices),
        reference=frozen_array(vertices[0]),
        normal=frozen_array(normal),
        T_face_object=pin.SE3(rotation, -rotation @ vertices[0]),
        area=float(outline.volume),
        rolls=rolls,
    )


def outermost_rows(points: Array, count: int) -> Index:
    """Rows of points (n, 2) that are extreme in so many evenly spread directions."""
    angles = 2.0 * np.pi * np.arange(count) / count
    return np.unique((points @ np.stack((np.cos(angles), np.sin(angles)))).argmax(axis=0))


def _axes_along(vertices: Array, normal: Array) -> Array:
    """(3, 3) rows: x along the longest edge of the polygon, z against the normal."""
    # The longest edge, without what leaves the plane.
    edges = np.roll(vertices, -1, axis=0) - vertices
    along = edges[np.argmax(np.linalg.norm(edges, axis=1))]
    along = along - (along @ normal) * normal
    along /= np.linalg.norm(along)
    return np.stack((along, np.cross(-normal, along), -normal))
