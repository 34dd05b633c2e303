"""Parts of pictures for people: robots and target volumes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
import trimesh
from matplotlib.axes import Axes
from scipy.spatial import ConvexHull

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.pictures.rendering import Image, Mesh, Viewpoint
from placement_planner_ros.scenes.primitives import Colour

Triangles = npt.NDArray[np.int64]

PLACED: Colour = (0.15, 0.70, 0.25)
START: Colour = (0.55, 0.55, 0.60)
LINK: Colour = (0.88, 0.88, 0.90)
HAND: Colour = (0.35, 0.36, 0.42)
VOLUME: Colour = (0.85, 0.15, 0.55)
SEE_THROUGH = 0.28
OVERSAMPLING = 2


def moved(vertices: Array, T: pin.SE3) -> Array:
    """Vertices (n, 3) at T."""
    return np.asarray(np.asarray(vertices) @ T.rotation.T + T.translation)


def box_corners(lower: Array, upper: Array) -> Array:
    """(8, 3): bit k of the row says whether coordinate k is the upper one."""
    is_upper = (np.arange(8)[:, None] >> np.arange(3)) & 1
    return np.where(is_upper == 1, upper, lower)


def averaged(colours: Array) -> Array:
    """Every `OVERSAMPLING` squared pixels as one, which smooths edges."""
    n = OVERSAMPLING
    parts = [colours[row::n, column::n] for row in range(n) for column in range(n)]
    return np.asarray(sum(parts[1:], parts[0]) / n**2)


class RobotShapes:
    """The collision shapes of a robot as meshes, made once for many configurations.

    Args:
        hand_links: links in the darker colour, such as an arm's touch links.
    """

    def __init__(self, robot: Robot, hand_links: Sequence[str] = ()) -> None:
        self._robot = robot
        self._shapes = [
            (*_shape_mesh(thing.geometry), HAND if link in hand_links else LINK)
            for thing, link in zip(
                robot.geometry.geometryObjects, robot.geometry_links, strict=True
            )
        ]

    def at(self, q: Array) -> list[Mesh]:
        """Each shape at q (nq,)."""
        poses = self._robot.geometry_poses(q)
        return [
            Mesh(moved(vertices, T), triangles, colour)
            for (vertices, triangles, colour), T in zip(self._shapes, poses, strict=True)
        ]


def robot_meshes(robot: Robot, q: Array, hand_links: Sequence[str]) -> list[Mesh]:
    """Each collision shape at q (nq,), `hand_links` in the darker colour."""
    return RobotShapes(robot, hand_links).at(q)


def _shape_mesh(shape: coal.CollisionGeometry) -> tuple[Array, Triangles]:
    """Vertices (n, 3) and triangles (t, 3) of a collision mesh in its own frame."""
    if isinstance(shape, coal.BVHModelBase):
        vertices = np.array(shape.vertices())
        indices = [[shape.tri_indices(i)[k] for k in range(3)] for i in range(shape.num_tris)]
        return vertices, np.array(indices, dtype=np.int64)
    if isinstance(shape, coal.ConvexBase):
        vertices = np.array(shape.points())
        return vertices, ConvexHull(vertices).simplices.astype(np.int64)
    primitive = _primitive_mesh(shape)
    if primitive is not None:
        return np.array(primitive.vertices), np.array(primitive.faces, dtype=np.int64)
    raise TypeError(f"cannot draw a {type(shape).__name__}")


def _primitive_mesh(shape: coal.CollisionGeometry) -> trimesh.Trimesh | None:
    if isinstance(shape, coal.Box):
        return trimesh.creation.box(2.0 * shape.halfSide)
    if isinstance(shape, coal.Sphere):
        return trimesh.creation.icosphere(subdivisions=2, radius=shape.radius)
    if isinstance(shape, coal.Cylinder):
        return trimesh.creation.cylinder(shape.radius, 2.0 * shape.halfLength)
    if isinstance(shape, coal.Capsule):
        made = trimesh.creation.capsule(2.0 * shape.halfLength, shape.radius)
        made.apply_translation(-made.bounds.mean(axis=0))
        return made
    return None


def translucent(solids: Sequence[Mesh], which: Sequence[bool]) -> list[Mesh]:
    """The solids, some of them see-through."""
    return [
        replace(solid, alpha=SEE_THROUGH) if hide else solid
        for solid, hide in zip(solids, which, strict=True)
    ]


def hiding(view: Viewpoint, placed: Array, solids: Sequence[Mesh]) -> list[bool]:
    """Which solids (their hulls) stand between the eye and the object's corners or centre."""
    targets = np.vstack([placed, placed.mean(axis=0)])
    targets = targets[:: max(1, len(targets) // 40)]
    shares = np.linspace(0.3, 0.98, 120)[:, None, None]
    along = (view.eye + shares * (targets - view.eye)).reshape(-1, 3)
    result = []
    for solid in solids:
        faces = ConvexHull(solid.vertices).equations
        depth = -(along @ faces[:, :3].T + faces[:, 3]).max(axis=1)
        inside = depth.reshape(len(shares), -1) > 1e-3
        result.append(bool(inside.any(axis=0).mean() > 0.1))
    return result


def draw_volume(axes: Axes, view: Viewpoint, image: Image, volume: TargetVolume) -> None:
    """The edges of V's boxes: solid where seen, dotted where something is in front."""
    for box in volume.joined:
        _draw_box(axes, view, image, box_corners(*box))


def _draw_box(axes: Axes, view: Viewpoint, image: Image, corners: Array) -> None:
    for i in range(8):
        for axis in range(3):
            if not i >> axis & 1:
                ends = corners[[i, i | 1 << axis]]
                steps = np.linspace(0, 1, 200)[:, None]
                line = view.project(ends[0] + steps * (ends[1] - ends[0]))
                seen = _seen_points(image, line)
                for mask, style, thick, alpha in ((seen, "-", 1.4, 1.0), (~seen, ":", 1.0, 0.6)):
                    u, v = np.where(mask[:, None], line[:, :2], np.nan).T
                    axes.plot(u, v, style, color=VOLUME, linewidth=thick, alpha=alpha)


def _seen_points(image: Image, line: Array) -> npt.NDArray[np.bool_]:
    height, width = image.depth.shape
    u = np.clip(line[:, 0].astype(int), 0, width - 1)
    v = np.clip(line[:, 1].astype(int), 0, height - 1)
    return np.asarray(line[:, 2] < image.depth[v, u] + 2e-3)
