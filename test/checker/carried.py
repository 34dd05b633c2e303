"""What of an object rests on what: the parts of its surface over parts of facets of solids."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from .surface import upward_facets
from .task import Array, Task, Tolerances, world_vertices

TIP = np.deg2rad(5.0)
"""By which an object can be tipped at least where it stands by polygon."""


def carried_polygon(
    task: Task, T_world_object: Array, normal: Array, tolerances: Tolerances
) -> Array:
    """(k, 2) corners of the hull of what carries an object, anticlockwise; none where it falls.

    Each triangle of the object, cut off above the flatness, is cut with each facet at the height
    of the object's lowest point. Coordinates are those of `plane_axes`.
    """
    axes = plane_axes(normal)
    world = world_vertices(task, T_world_object)
    lowest = float((world @ normal).min())
    triangles = world[np.asarray(task.object_triangles)]
    near = (triangles @ normal).min(axis=1) <= lowest + tolerances.flatness
    reach = tolerances.contact + tolerances.height
    facets = []
    for solid in task.solids:
        vertices = np.asarray(solid.vertices)
        for facet in upward_facets(solid, tolerances.slope):
            aligned = np.arccos(min(float(facet.normal @ normal), 1.0)) <= tolerances.lean
            if aligned and abs(float(facet.point @ normal) - lowest) <= reach:
                of_plane = np.abs((vertices - facet.point) @ facet.normal) <= 1e-6
                facets.append(_outline(vertices[of_plane] @ axes.T))
    found = [np.zeros((0, 2))]
    for triangle in triangles[near]:
        # what of it is not above that height along the normal
        height = lowest + tolerances.flatness
        touching = _kept(triangle, triangle @ normal - height) @ axes.T
        for outline in facets:
            apart = (touching.min(axis=0) > outline.max(axis=0)) | (
                touching.max(axis=0) < outline.min(axis=0)
            )
            if not apart.any():
                found.append(clipped(touching, outline))
    return _outline(np.concatenate(found))


def plane_axes(normal: Array) -> Array:
    """(2, 3) of a plane, right-handed with its normal."""
    first = np.cross([0.0, 1.0, 0.0], normal)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


def check_carried(
    task: Task, T_world_object: Array, normal: Array, tolerances: Tolerances
) -> list[str]:
    """What is wrong with how an object stands by polygon: the hull, the margin, the tilt."""
    hull = carried_polygon(task, T_world_object, normal, tolerances)
    if len(hull) < 3:
        return ["stance: fewer than three places carry it, or they are in line"]
    axes = plane_axes(normal)
    world = world_vertices(task, T_world_object)
    center = T_world_object[:3, :3] @ task.center_of_mass + T_world_object[:3, 3]
    height = float(center @ normal - (world @ normal).min())
    margin, tilt = np.inf, np.inf
    up = np.array([0.0, 0.0, 1.0])
    for a, b in zip(hull, np.roll(hull, -1, axis=0), strict=True):
        edge = (b - a) / np.linalg.norm(b - a)
        inward = np.array([-edge[1], edge[0]])
        inside = float(inward @ (axes @ center - a))
        falls = float(inward @ (axes @ up)) / float(normal @ up)
        margin = min(margin, inside - height * falls)
        tilt = min(tilt, float(np.arctan2(inside, height) - np.arctan(falls)))
    found = []
    if margin < task.support_margin - tolerances.carried:
        found.append(
            f"stance: centre of mass {1000 * margin:.1f} mm within what carries it instead of "
            f"{1000 * task.support_margin:g}"
        )
    if tilt < TIP - tolerances.lean:
        found.append(f"stance: falls when it is tipped by {np.rad2deg(tilt):.2f}°")
    return found


def _outline(points: Array) -> Array:
    """(k, 2) corners of the hull of (n, 2), anticlockwise; none where it has no area."""
    if len(points) < 3:
        return np.zeros((0, 2))
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return np.zeros((0, 2))


def clipped(polygon: Array, outline: Array) -> Array:
    """(k, 2) what of a polygon lies within a convex outline, anticlockwise."""
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        if len(polygon) == 0:
            break
        along = b - a
        off = along[1] * (polygon[:, 0] - a[0]) - along[0] * (polygon[:, 1] - a[1])
        polygon = _kept(polygon, off)
    return polygon


def _kept(polygon: Array, over: Array) -> Array:
    """The part of a polygon (n, d) where a value that is linear in it (n,) is not positive."""
    kept = []
    for k in range(len(polygon)):
        following = (k + 1) % len(polygon)
        if over[k] <= 0.0:
            kept.append(polygon[k])
        if over[k] * over[following] < 0.0:
            share = over[k] / (over[k] - over[following])
            kept.append(polygon[k] + share * (polygon[following] - polygon[k]))
    return np.array(kept).reshape(-1, polygon.shape[1])
