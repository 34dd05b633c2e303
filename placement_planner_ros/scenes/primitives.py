"""Convex primitives: solids from which the bundled scenes and objects are built.

Every solid is the convex hull of its vertices, exactly: a "cylinder" is the prism over a regular
polygon with its corners on the circle (at 48 sides the flats lie 0.2 % of the radius inside).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from placement_planner_ros.core.body.convex_part import polytope_of
from placement_planner_ros.core.body.mesh_components import Triangles
from placement_planner_ros.core.types import Array

Colour = tuple[float, float, float]

COPLANAR_M = 1e-7
"""m from a face, within which a point is on it."""


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPrimitive:
    """A named convex solid.

    Attributes:
        name: what it is; the pieces of one thing are named `thing/piece`.
        vertices: (n, 3) corners of the hull, metres, in the world (or object) frame.
        colour: red, green, blue in 0…1.
        triangles: (t, 3) indices into `vertices`, counter-clockwise seen from outside.
        normals, offsets: (p, 3) and (p,), one per flat face; inside is `normals @ x <= offsets`.
    """

    name: str
    vertices: Array
    colour: Colour = (0.7, 0.7, 0.7)
    triangles: Triangles = field(init=False)
    normals: Array = field(init=False)
    offsets: Array = field(init=False)

    def __post_init__(self) -> None:
        part = polytope_of(np.asarray(self.vertices, dtype=np.float64))
        for name in ("vertices", "triangles", "normals", "offsets"):
            object.__setattr__(self, name, getattr(part, name))

    def polygon(self, face: int) -> Array:
        """(k, 3) corners of one flat face, counter-clockwise seen from outside."""
        normal = self.normals[face]
        # corners of the face, by angle about its middle
        on_plane = np.abs(self.vertices @ normal - self.offsets[face]) < 1e-6
        corners = self.vertices[on_plane]
        u = corners[1] - corners[0]
        u /= np.linalg.norm(u)
        flat = (corners - corners.mean(axis=0)) @ np.column_stack([u, np.cross(normal, u)])
        return np.asarray(corners[np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))])

    def depth(self, points: Array) -> Array:
        """How deep each of the (n, 3) points lies inside: (n,), metres, negative outside.

        Inside it is the distance to the nearest face; outside, a lower bound of the (negated)
        distance.
        """
        return np.asarray((self.offsets - points @ self.normals.T).min(axis=1))


def box(
    name: str, lower: Sequence[float], upper: Sequence[float], colour: Colour
) -> ConvexPrimitive:
    """Axis-aligned box between two corners."""
    corners = list(product(*zip(lower, upper, strict=True)))
    return ConvexPrimitive(name, np.array(corners, dtype=np.float64), colour)


def standing_box(
    name: str,
    size: Sequence[float],
    centre: Sequence[float],
    yaw: float,
    bottom: float,
    colour: Colour,
) -> ConvexPrimitive:
    """Box of `size` (length, width, height) on the plane z = `bottom`.

    Args:
        centre: (2,) x and y of its footprint's centre.
        yaw: radians from the x axis to the box's length, about z.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    half = np.array(size, dtype=np.float64) / 2
    # the footprint turned about its centre, below and above
    corners = [
        [centre[0] + c * x - s * y, centre[1] + s * x + c * y, z]
        for x in (-half[0], half[0])
        for y in (-half[1], half[1])
        for z in (bottom, bottom + size[2])
    ]
    return ConvexPrimitive(name, np.array(corners), colour)


def circle(radius: float, z: float, sides: int, centre: Sequence[float] = (0.0, 0.0)) -> Array:
    """(sides, 3) corners on a horizontal circle, the first in direction +x."""
    angles = np.arange(sides) * 2 * np.pi / sides
    return np.column_stack(
        [
            centre[0] + radius * np.cos(angles),
            centre[1] + radius * np.sin(angles),
            np.full(sides, z),
        ]
    )


def frustum(
    name: str,
    radii: tuple[float, float],
    heights: tuple[float, float],
    colour: Colour,
    centre: Sequence[float] = (0.0, 0.0),
    sides: int = 48,
) -> ConvexPrimitive:
    """Upright frustum (a cylinder where the radii are equal) about the axis through `centre`.

    Args:
        radii, heights: m, below and above.
    """
    rings = [circle(r, z, sides, centre) for r, z in zip(radii, heights, strict=True)]
    return ConvexPrimitive(name, np.vstack(rings), colour)


def bowl(
    name: str,
    size: tuple[float, float],
    centre: Sequence[float],
    colour: Colour,
    wall: float = 0.004,
) -> tuple[ConvexPrimitive, ...]:
    """Round bowl open above: a floor disk and a ring of 24 convex wall segments.

    Args:
        size: diameter and height, m.
        centre: (3,) of its underside.
        wall: m, thickness.
    """
    outer, inner, sides = size[0] / 2, size[0] / 2 - wall, 24
    bottom, low, high = centre[2], centre[2] + wall, centre[2] + size[1]
    pieces = [frustum(f"{name}/floor", (outer, outer), (bottom, low), colour, centre, sides)]
    rings = [circle(r, z, sides, centre) for r in (inner, outer) for z in (low, high)]
    for i in range(sides):
        # of each segment four corners at either end: inside and outside, below and above
        corners = np.array([ring[k] for ring in rings for k in (i, (i + 1) % sides)])
        pieces.append(ConvexPrimitive(f"{name}/wall_{i}", corners, colour))
    return tuple(pieces)
