"""Drops a body onto a plane in a physics engine: where it comes to rest, and whether it stays.

A plane touches nothing of a body but its convex hull, so mujoco's hull of a mesh is exact here, of
hollow things too. Their mass is that of what they are made of.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import trimesh
from checker import object_pieces, piece_voxels
from scipy.spatial import ConvexHull

FRICTION = 0.8
_MASS = 0.5
_STEP, _STEPS = 0.002, 10
_SLOWS = 0.7
"""Seconds in which turning becomes 2.7 times as slow."""
_STILL, _TREMBLES = 25, 0.005
"""Looks, each after `_STEPS` steps, over which a body at rest turns by no more than that, radians:
contacts with a plane tremble."""


@dataclass(frozen=True)
class Mass:
    """Of uniform density.

    Attributes:
        volume: m³.
        center: (3,) metres.
        inertia: (3, 3) m², about the centre, of 1 kg.
    """

    volume: float
    center: np.ndarray
    inertia: np.ndarray


def mass_of(mesh: trimesh.Trimesh, spacing: float = 0.0025) -> Mass:
    """Of the union of a mesh's closed components; of several by cells so large, metres."""
    pieces = object_pieces(mesh.vertices, mesh.faces)
    if len(pieces) == 1:
        welded = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
        return Mass(welded.volume, welded.center_mass, welded.moment_inertia / welded.volume)
    cells = piece_voxels(pieces, spacing)
    center = cells.mean(axis=0)
    away = cells - center
    inertia = np.mean(away**2, axis=0).sum() * np.eye(3) - away.T @ away / len(cells)
    return Mass(len(cells) * spacing**3, center, inertia)


@dataclass(frozen=True)
class Fallen:
    """Where a body came to rest.

    Attributes:
        down: (3,) the direction in its own frame that is down.
        moved: metres, of its centre of mass sideways.
        still: whether it was at rest when the time was over.
    """

    down: np.ndarray
    moved: float
    still: bool


class Drops:
    """One body over a plane.

    Args:
        points: (n, 3) of it, metres.
        mass: its own.
    """

    def __init__(self, points: np.ndarray, mass: Mass) -> None:
        hull = ConvexHull(points - mass.center)
        self._vertices = (points - mass.center)[hull.vertices]
        moments, axes = np.linalg.eigh(_MASS * mass.inertia)
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0
        turned = np.zeros(4)
        mujoco.mju_mat2Quat(turned, axes.ravel())
        spec = mujoco.MjSpec()
        spec.option.timestep = _STEP
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio = 10.0
        friction = [FRICTION, 0.005, 0.0001]
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1], friction=friction
        )
        spec.add_mesh(
            name="body",
            uservert=self._vertices.ravel().tolist(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
        )
        body = spec.worldbody.add_body(name="body")
        body.add_freejoint()
        body.explicitinertial, body.mass, body.ipos = True, _MASS, [0, 0, 0]
        body.iquat, body.inertia = turned, moments
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="body", friction=friction)
        self._model = spec.compile()
        # Without any loss, what rocks or rolls would go on for ever.
        self._model.dof_damping[3:] = moments / _SLOWS

    def height(self, down: np.ndarray) -> float:
        """Metres of the centre of mass over a plane that touches, with that direction down."""
        return float((self._vertices @ down).max())

    def drop(
        self, down: np.ndarray, yaw: float, height: float, push: float = 0.0, seconds: float = 4.0
    ) -> Fallen:
        """Let go of from so far above the plane, metres.

        Args:
            down: (3,) unit, in the body's frame.
            push: m/s along x to begin with, as it rests.
        """
        data = mujoco.MjData(self._model)
        rotation = _standing(down, yaw)
        mujoco.mju_mat2Quat(data.qpos[3:], rotation.ravel())
        data.qpos[2] = height - (self._vertices @ rotation.T)[:, 2].min()
        data.qvel[0] = push
        still, at_rest = 0, down
        while data.time < seconds and still < _STILL:
            mujoco.mj_step(self._model, data, _STEPS)
            now = -data.xmat[1].reshape(3, 3)[2]
            still = still + 1 if np.linalg.norm(now - at_rest) < _TREMBLES else 0
            at_rest = at_rest if still else now
        fallen = -data.xmat[1].reshape(3, 3)[2]
        moved = float(np.linalg.norm(data.qpos[:2]))
        return Fallen(fallen / np.linalg.norm(fallen), moved, still >= _STILL)


def _standing(down: np.ndarray, yaw: float) -> np.ndarray:
    z = -down
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    cos, sin = np.cos(yaw), np.sin(yaw)
    about = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return about @ np.stack([x, np.cross(z, x), z])
