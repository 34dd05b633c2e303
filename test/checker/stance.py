"""An object that is left standing: on its face, within V."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from .carried import carried_polygon, check_carried
from .surface import feet_of, gaps_below, normals_of, surface_normal
from .task import Array, Task, Tolerances, world_vertices


def check_stance(task: Task, T_world_object: Array, tolerances: Tolerances) -> list[str]:
    """What is wrong with an object left at a pose (4, 4): standing on its face, within V.

    On a slope it stands along the surface's normal, and its centre of mass is above its face along
    gravity.
    """
    T, found = T_world_object, []
    normal = standing_along(task, T, tolerances)
    feet = feet_of(world_vertices(task, T), normal, tolerances)
    com = T[:3, :3] @ task.center_of_mass + T[:3, 3]
    if task.support == "polygon":
        return check_carried(task, T, normal, tolerances) + _foot_in_volume(
            task, com, com - (com - feet[0]) @ normal * normal, tolerances
        )
    if len(feet) < 3 or np.linalg.matrix_rank(feet[1:, :2] - feet[0, :2], tol=1e-4) < 2:
        found.append("stance: stands on an edge or a corner")
    else:
        hull = ConvexHull(feet[:, :2])
        if (hull.equations[:, :2] @ com[:2] + hull.equations[:, 2]).max() > 0:
            found.append("stance: centre of mass beyond the face it stands on")
        across = np.linalg.svd(feet - feet.mean(axis=0))[2][-1]
        lean = float(np.arccos(min(abs(float(across @ normal)), 1.0)))
        if lean > tolerances.lean:
            found.append(f"stance: leans by {np.rad2deg(lean):.2f}° on what it stands on")
    gaps = gaps_below(task.solids, feet, normal, tolerances)
    if gaps.max() > tolerances.contact + tolerances.height:
        where = feet[np.argmax(gaps)].round(4).tolist()
        found.append(f"stance: nothing under the vertex at {where}")
    slack = np.array([1e-6, 1e-6, tolerances.contact])
    lower, upper = task.volume[:, 0] - slack, task.volume[:, 1] + slack
    ends = feet[:, 2].min(), feet[:, 2].max()  # on a slope some foot is the contact point
    at_height = (lower[:, 2] <= ends[1]) & (ends[0] <= upper[:, 2])
    touched = (feet[:, None] >= lower) & (feet[:, None] <= upper)
    if not touched.all(axis=2).any():
        found.append("volume: no contact point in V")
    over = ((com >= lower) & (com <= upper))[:, :2].all(axis=1)
    if not (over & at_height if at_height.any() else over).any():
        found.append("volume: centre of mass not over V")
    return found


def standing_along(task: Task, T_world_object: Array, tolerances: Tolerances) -> Array:
    """(3,) the normal of what an object at a pose (4, 4) stands on; z where it stands on nothing.

    By polygon, that of the facets which carry it on most area.
    """
    if task.support != "polygon":
        return surface_normal(task, T_world_object, tolerances)
    best, most = np.array([0.0, 0.0, 1.0]), 0.0
    for normal in normals_of(task, tolerances):
        hull = carried_polygon(task, T_world_object, normal, tolerances)
        if len(hull) >= 3 and ConvexHull(hull).volume > most + 1e-6:
            best, most = normal, float(ConvexHull(hull).volume)
    return best


def _foot_in_volume(task: Task, com: Array, foot: Array, tolerances: Tolerances) -> list[str]:
    """Whether the point of the contact plane under the centre of mass, along its normal, is in V,
    and that centre over V."""
    slack = np.array([1e-6, 1e-6, tolerances.contact])
    lower, upper = task.volume[:, 0] - slack, task.volume[:, 1] + slack
    found = []
    if not ((foot >= lower) & (foot <= upper)).all(axis=1).any():
        found.append("volume: what is under the centre of mass is not in V")
    if not ((com >= lower) & (com <= upper))[:, :2].all(axis=1).any():
        found.append("volume: centre of mass not over V")
    return found
