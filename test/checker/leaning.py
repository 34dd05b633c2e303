"""Does an object that leans stay? A friction cone program of its own, over the true solids."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from .task import Array, Task, Tolerances, world_vertices

TILT = np.deg2rad(3.0)
SIDES, WAYS = 16, 12


def touched(task: Task, T: Array, tolerances: Tolerances) -> tuple[Array, Array, set[str]]:
    """Where vertices of an object at a pose (4, 4) touch, what normals the solids have there, and
    which these are."""
    points, normals, names = [], [], set()
    vertices = world_vertices(task, T)
    for solid in task.solids:
        planes = np.column_stack([solid.normals, -solid.offsets])
        away = vertices @ planes[:, :3].T + planes[:, 3]
        outside, facet = away.max(axis=1), away.argmax(axis=1)
        near = np.abs(outside) <= tolerances.contact + tolerances.height
        if near.any():
            points.append(vertices[near])
            normals.append(planes[facet[near], :3])
            names.add(solid.name)
    if not points:
        return np.zeros((0, 3)), np.zeros((0, 3)), names
    return np.vstack(points), np.vstack(normals), names


def check_leaning(task: Task, T: Array, tolerances: Tolerances) -> list[str]:
    """What is wrong with an object left leaning at a pose (4, 4)."""
    assert task.friction is not None
    points, normals, _ = touched(task, T, tolerances)
    center = T[:3, :3] @ task.center_of_mass + T[:3, 3]
    found = []
    if not (normals[:, 2] > 0.99).any():
        found.append("lean: nothing under it")
    if not (np.abs(normals[:, 2]) < 0.5).any():
        found.append("lean: nothing behind it")
    return found or balance(points, normals, center, task.friction, task.stability_margin)


def balance(
    points: Array, normals: Array, center: Array, friction: float, margin: float
) -> list[str]:
    """In which directions the weight with a wrench more is not borne by friction cones."""
    columns = []
    for point, normal in zip(points, normals, strict=True):
        basis = np.linalg.svd(normal[None])[2][1:]
        for turn in 2 * np.pi * np.arange(SIDES) / SIDES:
            force = normal + friction * (np.cos(turn) * basis[0] + np.sin(turn) * basis[1])
            columns.append(np.concatenate([force, 10.0 * np.cross(point - center, force)]))
    found = []
    for way in 2 * np.pi * np.arange(WAYS) / WAYS:
        aside = (margin + np.tan(TILT)) * np.array([np.cos(way), np.sin(way)])
        load = np.concatenate([-aside, [1.0, 0.0, 0.0, 0.0]])
        answer = linprog(np.ones(len(columns)), A_eq=np.array(columns).T, b_eq=load)
        if answer.status != 0:
            found.append(f"lean: gives way towards {np.rad2deg(way):.0f}°")
    return found
