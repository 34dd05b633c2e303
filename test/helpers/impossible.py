"""Looks for a pose where there is to be none, by plain geometry: rests, facets and hulls.

Random poses are judged by how far the corners that an object stands on are beside what could carry
them; the best are moved about to get them in. One that stands is held against all solids. But for
the margin at edges, none is asked for unless given.
"""

from __future__ import annotations

import coal
import numpy as np
from checker.shapes import convex
from scipy.spatial import ConvexHull

from benchmarks.household import object_by_name
from placement_planner_ros.core.body.body import Body

_NEAR = 0.004
"""m in height within which a surface is the one that is meant."""
_TOUCH = 2e-4


def rests(thing):
    """Rotations that put down a side which the object stands on firmly, where its origin is then,
    and the corners (k, 2) of that side; the centre of mass is above x = y = 0."""
    held = object_by_name(thing)
    for face in Body.from_mesh(held.vertices, held.triangles, held.center_of_mass).faces:
        z = -np.asarray(face.normal)
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x /= np.linalg.norm(x)
        rotation = np.stack([x, np.cross(z, x), z])
        points = held.vertices @ rotation.T
        offset = rotation @ held.center_of_mass
        offset[2] = points[:, 2].min()
        feet = (points - offset)[points[:, 2] < offset[2] + 1e-3, :2]
        yield rotation, offset, feet[ConvexHull(feet).vertices]


def facets(situation):
    """Outlines (k, 3) of a x + b y + c <= 0 of level tops within V's height, and their heights."""
    low, high = situation.scene.volume.lower[2], situation.scene.volume.upper[2]
    found = []
    for part in situation.scene.parts:
        top = part.vertices[:, 2].max()
        corners = part.vertices[part.vertices[:, 2] > top - 1e-6][:, :2]
        if low - 1e-9 <= top <= high + 1e-9 and len(corners) >= 3:
            found.append((ConvexHull(corners).equations, float(top)))
    return found


def beside(corners, tops, height, edge):
    """(n,) how far, at most, a corner (n, k, 2) is beside all tops of about that height, or how
    much nearer than `edge` to their ends, m."""
    away = np.full(corners.shape[:2], np.inf)
    for outline, top in tops:
        if abs(top - height) <= _NEAR:
            off = (corners @ outline[:, :2].T + outline[:, 2]).max(axis=2)
            away = np.minimum(away, np.maximum(off + edge, 0.0))
    return away.max(axis=1)


def placed(feet, xy, angle):
    """(n, k, 2) corners turned and moved."""
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([cos, -sin], 1), np.stack([sin, cos], 1)], 1)
    return feet @ turn.transpose(0, 2, 1) + xy[:, None]


_TRIED = 20
"""Poses at each height and in each rest that are tried for room, of those that would stand."""


def pose_that_stands(situation, rng, edge=0.0, samples=4000, best=60, rounds=60):
    """(rotation, xy, angle, height) of a pose that is possible after all; None where none is found.

    With every corner on something, `edge` metres from its end, as s(x) by vertices asks; the centre
    of mass over V, and a corner in it.
    """
    tops, volume = facets(situation), situation.scene.volume
    for rotation, offset, feet in rests(situation.thing):
        for height in sorted({round(top, 6) for _, top in tops}):
            xy = rng.uniform(volume.lower[:2], volume.upper[:2], (samples, 2))
            angle = rng.uniform(-np.pi, np.pi, samples)
            away = beside(placed(feet, xy, angle), tops, height, edge)
            rows = np.argsort(away)[:best]
            xy, angle, away = xy[rows], angle[rows], away[rows]
            step = np.full(best, 0.02)
            for _ in range(rounds):
                near = xy + step[:, None] * rng.normal(size=xy.shape)
                near = np.clip(near, volume.lower[:2], volume.upper[:2])
                turned = angle + 10.0 * step * rng.normal(size=best)
                now = beside(placed(feet, near, turned), tops, height, edge)
                better = now <= away
                xy[better], angle[better], away[better] = near[better], turned[better], now[better]
                step = np.where(better, step, 0.85 * step)
            inside = _over(volume, xy[:, None]).all(axis=1)
            inside &= _over(volume, placed(feet, xy, angle)).any(axis=1)
            for row in np.flatnonzero((away <= 0.0) & inside)[:_TRIED]:
                if _free(situation, rotation, offset, xy[row], angle[row], height):
                    return rotation, xy[row], angle[row], height
    return None


def _over(volume, xy):
    """(n, k) whether points (n, k, 2) are over V."""
    low, high = volume.boxes[:, 0, :2], volume.boxes[:, 1, :2]
    at = xy[:, :, None]
    return ((at >= low) & (at <= high)).all(axis=3).any(axis=2)


def _free(situation, rotation, offset, xy, angle, height):
    """Whether the object's parts meet no solid there."""
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    at = coal.Transform3s.Identity()
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    for part in object_by_name(situation.thing).parts:
        points = (part.vertices @ rotation.T - offset) @ turn.T + [*xy, height]
        shape = convex(points)
        for solid in situation.scene.parts:
            other = convex(solid.vertices)
            if coal.distance(shape, at, other, at, request, coal.DistanceResult()) < -_TOUCH:
                return False
    return True
