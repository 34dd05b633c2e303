"""An object that is left standing: on its face, within V."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from .task import Array, Solid, Task, Tolerances, world_vertices


def check_stance(task: Task, T_world_object: Array, tolerances: Tolerances) -> list[str]:
    """What is wrong with an object left at a pose (4, 4): standing on its face, within V."""
    T, found = T_world_object, []
    vertices = world_vertices(task, T)
    lowest = vertices[:, 2].min()
    feet = np.unique(vertices[vertices[:, 2] <= lowest + tolerances.flatness], axis=0)
    com = T[:3, :3] @ task.center_of_mass + T[:3, 3]
    if len(feet) < 3 or np.linalg.matrix_rank(feet[1:, :2] - feet[0, :2], tol=1e-4) < 2:
        found.append("stance: stands on an edge or a corner")
    else:
        hull = ConvexHull(feet[:, :2])
        if (hull.equations[:, :2] @ com[:2] + hull.equations[:, 2]).max() > 0:
            found.append("stance: centre of mass beyond the face it stands on")
    gaps = np.array([_gap(task.solids, foot, tolerances.edge) for foot in feet])
    if gaps.max() > tolerances.contact + tolerances.height:
        where = feet[np.argmax(gaps)].round(4).tolist()
        found.append(f"stance: nothing under the vertex at {where}")
    slack = np.array([1e-6, 1e-6, tolerances.contact])
    lower, upper = task.volume[:, 0] - slack, task.volume[:, 1] + slack
    at_height = (lower[:, 2] <= lowest) & (lowest <= upper[:, 2])
    touched = (feet[:, None] >= lower) & (feet[:, None] <= upper)
    if not touched.all(axis=2).any():
        found.append("volume: no contact point in V")
    over = ((com >= lower) & (com <= upper))[:, :2].all(axis=1)
    if not (over & at_height if at_height.any() else over).any():
        found.append("volume: centre of mass not over V")
    return found


def _gap(solids: Sequence[Solid], point: Array, edge: float) -> float:
    """Vertical distance between a point and the horizontal top surface nearest in height."""
    best = np.inf
    for solid in solids:
        top = float(solid.vertices[:, 2].max())
        corners = solid.vertices[solid.vertices[:, 2] > top - 1e-6]
        if len(corners) >= 3 and abs(float(point[2]) - top) < best:
            hull = ConvexHull(corners[:, :2])
            if (hull.equations[:, :2] @ point[:2] + hull.equations[:, 2]).max() <= edge:
                best = abs(float(point[2]) - top)
    return best
