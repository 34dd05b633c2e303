"""A small renderer for pictures: triangle meshes with a depth buffer, so that nothing is
drawn in front of what hides it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.types import Array
from placement_planner_ros.scenes.primitives import Colour

_LIGHT = np.array([-0.35, -0.45, 0.82]) / np.linalg.norm([-0.35, -0.45, 0.82])
_AMBIENT = 0.45


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of one colour.

    Attributes:
        vertices: (n, 3) in the world frame, metres.
        triangles: (t, 3) indices.
        alpha: 1 is opaque.
    """

    vertices: Array
    triangles: npt.NDArray[np.int64]
    colour: Colour
    alpha: float = 1.0


def joined(meshes: Iterable[Mesh]) -> list[Mesh]:
    """The same with those of one colour and alpha as one, which are sooner drawn."""
    # one draw for each colour
    alike: dict[tuple[Colour, float], list[Mesh]] = {}
    for mesh in meshes:
        alike.setdefault((mesh.colour, mesh.alpha), []).append(mesh)
    result = []
    for (colour, alpha), group in alike.items():
        first = np.cumsum([0, *(len(mesh.vertices) for mesh in group)])
        triangles = [mesh.triangles + start for mesh, start in zip(group, first, strict=False)]
        vertices = np.vstack([mesh.vertices for mesh in group])
        result.append(Mesh(vertices, np.vstack(triangles), colour, alpha))
    return result


def unit_direction(azimuth: float, elevation: float) -> Array:
    """(3,) towards an eye there, angles in rad."""
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


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
        # axes of the camera: to the right, down, along the view
        toward = unit_direction(*towards)
        right = np.cross(-toward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.vstack([right, np.cross(-toward, right), -toward])
        # half of what is seen at a distance of 1
        half = np.tan(opening / 2) * np.array([1.0, height / width])
        flat = points @ rotation.T
        centre = (flat.min(axis=0) + flat.max(axis=0)) / 2
        for _ in range(20):  # the middle of what is seen moves as the eye draws back
            distance = float((np.abs(flat[:, :2] - centre[:2]) / half - flat[:, 2:]).max())
            seen = (flat[:, :2] - centre[:2]) / (flat[:, 2:] + distance)
            shift = (seen.min(axis=0) + seen.max(axis=0)) / 2
            centre[:2] += shift * (centre[2] + distance)
        eye = rotation.T @ np.array([centre[0], centre[1], -distance * 1.03])
        return cls(eye, rotation, width, height, width / 2 / half[0])

    def project(self, points: Array) -> Array:
        """(n, 3) world points as pixel u, v and depth."""
        # perspective: divided by the depth
        seen = (points - self.eye) @ self.rotation.T
        uv = seen[:, :2] / seen[:, 2:] * self.focal_length
        middle = np.array([self.width, self.height]) / 2
        return np.column_stack([uv + middle, seen[:, 2]])


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """What was rendered.

    Attributes:
        colours: (height, width, 3) in 0…1.
        depth: (height, width) of the opaque surfaces, metres along the view; inf where none is.
    """

    colours: Array
    depth: Array


def render(view: Viewpoint, meshes: Sequence[Mesh], behind: Image | None = None) -> Image:
    """Opaque meshes first, then each translucent one's nearest surface over them, far to near.

    Args:
        behind: what was rendered of the same view before, which stays as it is; white without it.
    """
    if behind is None:
        colours = np.ones((view.height, view.width, 3))
        depth = np.full((view.height, view.width), np.inf)
    else:
        colours, depth = behind.colours.copy(), behind.depth.copy()
    for mesh in meshes:
        if mesh.alpha >= 1.0:
            _draw_mesh(view, mesh, colours, depth)
    # what is translucent is drawn apart, one after the other, and laid over from far to near
    layers = []
    for mesh in meshes:
        if mesh.alpha < 1.0:
            layer, layer_depth = np.empty_like(colours), depth.copy()
            _draw_mesh(view, mesh, layer, layer_depth)
            rows = layer_depth < depth
            if rows.any():
                layers.append((float(layer_depth[rows].mean()), mesh.alpha, rows, layer[rows]))
    for _, alpha, rows, layer in sorted(layers, key=lambda entry: -entry[0]):
        colours[rows] = alpha * layer + (1 - alpha) * colours[rows]
    return Image(colours, depth)


def _draw_mesh(view: Viewpoint, mesh: Mesh, colours: Array, depth: Array) -> None:
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    # flat shading by one light
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(length, 1e-30)[:, None]
    away = np.einsum("ij,ij->i", normals, a - view.eye) > 0
    normals[away] *= -1  # either side may be seen
    shade = _AMBIENT + (1 - _AMBIENT) * np.clip(normals @ _LIGHT, 0, 1)
    _fill_triangles(
        np.ascontiguousarray(view.project(mesh.vertices)),
        np.ascontiguousarray(mesh.triangles, dtype=np.int64),
        np.outer(shade, mesh.colour),
        colours,
        depth,
    )


@njit(cache=True, nogil=True)
def _fill_triangles(
    projected: Array,
    triangles: npt.NDArray[np.int64],
    shades: Array,
    colours: Array,
    depth: Array,
) -> None:
    """Draw triangles with projected corners (u, v, depth); none reaches behind the eye."""
    height, width = depth.shape
    for t in range(len(triangles)):
        a, b, c = projected[triangles[t, 0]], projected[triangles[t, 1]], projected[triangles[t, 2]]
        # twice the signed area: nothing is seen of a triangle from its edge, or behind the eye
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if min(a[2], b[2], c[2]) <= 1e-6 or abs(area) < 1e-12:
            continue
        # the pixels of its bounding box
        first_u = max(0, int(np.floor(min(a[0], b[0], c[0]))))
        last_u = min(width - 1, int(np.ceil(max(a[0], b[0], c[0]))))
        first_v = max(0, int(np.floor(min(a[1], b[1], c[1]))))
        last_v = min(height - 1, int(np.ceil(max(a[1], b[1], c[1]))))
        for v in range(first_v, last_v + 1):
            for u in range(first_u, last_u + 1):
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
