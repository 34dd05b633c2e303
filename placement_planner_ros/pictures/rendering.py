"""A small renderer for pictures: triangles with a depth buffer, so that nothing is drawn in front
of what hides it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.types import Array
from placement_planner_ros.scenes.primitives import Colour

_LIGHT = np.array([-0.35, -0.45, 0.82]) / np.linalg.norm([-0.35, -0.45, 0.82])


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of one colour.

    Attributes:
        corners: (t, 3, 3) in the world frame, metres.
        colour: red, green, blue in 0…1.
        glass: drawn on one pixel of four, so that a picture of half the pixels shows three quarters
            of what is behind it.
    """

    corners: Array
    colour: Colour
    glass: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Viewpoint:
    """A perspective camera.

    Attributes:
        eye: (3,) where it is.
        rotation: (3, 3) world to camera: x right, y down, z along the view.
        width, height: pixels.
        focal_length: pixels.
    """

    eye: Array
    rotation: Array
    width: int
    height: int
    focal_length: float

    @classmethod
    def around(
        cls, points: Array, towards: tuple[float, float], size: npt.ArrayLike, opening: float = 0.5
    ) -> Viewpoint:
        """A view of all of `points` (n, 3).

        Args:
            towards: azimuth and elevation of the eye, rad.
            size: width and height, pixels.
            opening: rad that the view is wide.
        """
        width, height = np.asarray(size, dtype=int).tolist()
        azimuth, elevation = towards
        flat = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        # axes of the camera: to the right, down, along the view
        view = -np.cos(elevation) * flat - np.array([0.0, 0.0, np.sin(elevation)])
        right = np.cross([0.0, 0.0, 1.0], flat)
        rotation = np.vstack([right, np.cross(view, right), view])
        # half of what is seen at a distance of 1
        half = np.tan(opening / 2) * np.array([1.0, height / width])
        turned = points @ rotation.T
        centre = (turned.min(axis=0) + turned.max(axis=0)) / 2
        for _ in range(20):  # the middle of what is seen moves as the eye draws back
            distance = float((np.abs(turned[:, :2] - centre[:2]) / half - turned[:, 2:]).max())
            seen = (turned[:, :2] - centre[:2]) / (turned[:, 2:] + distance)
            shift = (seen.min(axis=0) + seen.max(axis=0)) / 2
            centre[:2] += shift * (centre[2] + distance)
        eye = rotation.T @ np.array([centre[0], centre[1], -distance * 1.03])
        return cls(eye, rotation, width, height, width / 2 / half[0])

    def project(self, points: Array) -> Array:
        """World points (..., 3) as pixel u, v and depth."""
        # perspective: divided by the depth
        seen = (points - self.eye) @ self.rotation.T
        middle = np.array([self.width, self.height]) / 2
        seen[..., :2] = seen[..., :2] / seen[..., 2:] * self.focal_length + middle
        return np.asarray(seen)


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """What was rendered.

    Attributes:
        colours: (height, width, 3) in 0…1.
        depth: (height, width), metres along the view; inf where nothing is.
    """

    colours: Array
    depth: Array


def render(view: Viewpoint, meshes: Iterable[Mesh], behind: Image | None = None) -> Image:
    """The nearest of all surfaces at each pixel.

    Args:
        behind: what was rendered of the same view before, which stays as it is; white without it.
    """
    colours, depth = (
        np.ones((view.height, view.width, 3)),
        np.full((view.height, view.width), np.inf),
    )
    if behind is not None:
        colours, depth = behind.colours.copy(), behind.depth.copy()
    for mesh in meshes:
        a, b, c = np.moveaxis(mesh.corners, 1, 0)
        # flat shading by one light
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-30)[:, None]
        away = np.einsum("ij,ij->i", normals, a - view.eye) > 0
        normals[away] *= -1  # either side may be seen
        shades = np.outer(0.5 + 0.5 * np.clip(normals @ _LIGHT, 0, 1), mesh.colour)
        _fill_triangles(view.project(mesh.corners), shades, 2 if mesh.glass else 1, colours, depth)
    return Image(colours, depth)


@njit(cache=True, nogil=True)
def _fill_triangles(
    projected: Array, shades: Array, every: int, colours: Array, depth: Array
) -> None:
    """Draw triangles with projected corners (u, v, depth), in every first, second, ... row and
    column; none reaches behind the eye."""
    height, width = depth.shape
    for t in range(len(projected)):
        a, b, c = projected[t, 0], projected[t, 1], projected[t, 2]
        # twice the signed area: nothing is seen of a triangle from its edge, or behind the eye
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if min(a[2], b[2], c[2]) <= 1e-6 or abs(area) < 1e-12:
            continue
        # the pixels of its bounding box
        first_u = max(0, int(np.floor(min(a[0], b[0], c[0]))))
        last_u = min(width - 1, int(np.ceil(max(a[0], b[0], c[0]))))
        first_v = max(0, int(np.floor(min(a[1], b[1], c[1]))))
        last_v = min(height - 1, int(np.ceil(max(a[1], b[1], c[1]))))
        for v in range(first_v + first_v % every, last_v + 1, every):
            for u in range(first_u + first_u % every, last_u + 1, every):
                # barycentric weights: one is negative where the pixel's middle is outside
                x, y = u + 0.5, v + 0.5
                wa = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
                wb = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
                wc = 1.0 - wa - wb
                if wa < 0.0 or wb < 0.0 or wc < 0.0:
                    continue
                # the inverse of depth is linear in the picture; the nearest surface stays
                z = 1.0 / (wa / a[2] + wb / b[2] + wc / c[2])
                if z < depth[v, u]:
                    depth[v, u] = z
                    for k in range(3):
                        colours[v, u, k] = shades[t, k]
