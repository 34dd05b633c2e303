"""Does a released object stay where it was placed? Asks mujoco, an optional dependency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt
import pinocchio as pin
import trimesh
from scipy.spatial import ConvexHull

_DENSITY = 300.0
"""kg/m³, of packaged goods; motion under gravity hardly depends on it."""
_TIME_STEP = 0.001


@dataclass(frozen=True, slots=True)
class Settled:
    """How far an object came from where it was released.

    Attributes:
        moved: metres, of its centre of mass.
        tilted: radians, of the direction that was up.
    """

    moved: float
    tilted: float


def settle(
    scene_parts: Sequence[npt.NDArray[np.float64]],
    object_parts: Sequence[npt.NDArray[np.float64]],
    center_of_mass: npt.NDArray[np.float64],
    T_world_object: pin.SE3,
    seconds: float = 2.0,
    friction: float = 0.6,
    noslip: int = 0,
) -> Settled:
    """Release an object at rest and simulate it.

    Args:
        scene_parts: vertices (n, 3) of each convex part of the environment, world frame, metres.
        object_parts: vertices (n, 3) of each convex part of the object, in its frame.
        center_of_mass: (3,) in the object frame.
        T_world_object: where it is released.
        friction: sliding friction coefficient of every contact.
        noslip: iterations after which friction does not creep.

    Returns:
        Where it is after `seconds`, compared with its release.
    """
    spec = mujoco.MjSpec()
    spec.option.timestep = _TIME_STEP
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.noslip_iterations = noslip
    x, y, z, w = pin.Quaternion(T_world_object.rotation).normalized().coeffs()
    placed = spec.worldbody.add_body(
        name="object", pos=T_world_object.translation, quat=[w, x, y, z]
    )
    placed.add_freejoint()
    owners = [spec.worldbody] * len(scene_parts) + [placed] * len(object_parts)
    for number, (owner, vertices) in enumerate(
        zip(owners, [*scene_parts, *object_parts], strict=True)
    ):
        spec.add_mesh(name=str(number), uservert=np.ravel(vertices).tolist())
        owner.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=str(number),
            friction=[friction, 0.005, 0.0001],
        )
    mass, inertia = _inertia(object_parts, np.asarray(center_of_mass))
    rows, columns = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    placed.explicitinertial, placed.mass, placed.ipos = True, mass, center_of_mass
    placed.fullinertia = inertia[rows, columns]
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    body = model.body("object").id
    position, rotation = data.xipos[body].copy(), data.xmat[body].reshape(3, 3).copy()
    while data.time < seconds:
        mujoco.mj_step(model, data)
    turned = data.xmat[body].reshape(3, 3) @ rotation.T
    return Settled(
        moved=float(np.linalg.norm(data.xipos[body] - position)),
        tilted=float(np.arccos(np.clip(turned[2, 2], -1.0, 1.0))),
    )


def settle_placed(solids, held, T_world_object: pin.SE3, **physics) -> Settled:
    """`settle` for solids, and an object that has parts, with vertices each."""
    return settle(
        [np.asarray(solid.vertices) for solid in solids],
        [part.vertices for part in held.parts],
        held.center_of_mass,
        T_world_object,
        **physics,
    )


def _inertia(
    parts: Sequence[npt.NDArray[np.float64]], center_of_mass: npt.NDArray[np.float64]
) -> tuple[float, npt.NDArray[np.float64]]:
    """Mass, and (3, 3) inertia about the centre of mass; overlaps of parts count twice."""
    mass, inertia = 0.0, np.zeros((3, 3))
    for vertices in parts:
        hull = trimesh.Trimesh(vertices, ConvexHull(vertices).simplices).convex_hull
        part_mass = _DENSITY * float(hull.volume)
        arm = np.asarray(hull.center_mass) - center_of_mass
        mass += part_mass
        inertia += _DENSITY * np.asarray(hull.moment_inertia)
        inertia += part_mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, inertia
