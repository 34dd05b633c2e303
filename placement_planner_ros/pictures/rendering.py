"""A small renderer for pictures: triangles with a depth buffer, so that nothing is drawn in front
of what hides it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numba import njit

from placement_planner_ros.core.types import Array
from placement_planner_ros.scenes.clouds import DepthCamera
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


def camera_around(
    points: Array, towards: tuple[float, float], size: tuple[int, int]
) -> DepthCamera:
    """A camera that sees all of `points` (n, 3).

    Args:
        towards: azimuth and elevation of the camera from them, rad.
        size: width and height, pixels.
    """
    azimuth, elevation = towards
    level = np.cos(elevation)
    away = (level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation))
    turned = DepthCamera.looking_at("picture", away, (0.0, 0.0, 0.0)).T_world_camera.rotation
    # half of what is seen at a distance of 1, but for a rim
    focal_length = 2.0 * size[0]
    half = 0.97 / 2 * np.array(size) / focal_length
    # the sides of what is seen go through the outermost points on either side
    across, along = np.split(points @ turned, [2], axis=1)
    low, high = (across + half * along).min(axis=0), (across - half * along).max(axis=0)
    distance = ((high - low) / (2 * half)).max()
    eye = turned @ np.array([*(low + high) / 2, -distance])
    return DepthCamera("picture", pin.SE3(turned, eye), *size, focal_length)


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """What was rendered.

    Attributes:
        colours: (height, width, 3) in 0…1.
        depth: (height, width), metres along the view; inf where nothing is.
    """

    colours: Array
    depth: Array


def render(view: DepthCamera, meshes: Iterable[Mesh], behind: Image | None = None) -> Image:
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
        away = np.einsum("ij,ij->i", normals, a - view.T_world_camera.translation) > 0
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
                wa = ((b[0] - u) * (c[1] - v) - (b[1] - v) * (c[0] - u)) / area
                wb = ((c[0] - u) * (a[1] - v) - (c[1] - v) * (a[0] - u)) / area
                wc = 1.0 - wa - wb
                if wa < 0.0 or wb < 0.0 or wc < 0.0:
                    continue
                # the inverse of depth is linear in the picture; the nearest surface stays
                z = 1.0 / (wa / a[2] + wb / b[2] + wc / c[2])
                if z < depth[v, u]:
                    depth[v, u] = z
                    for k in range(3):
                        colours[v, u, k] = shades[t, k]
