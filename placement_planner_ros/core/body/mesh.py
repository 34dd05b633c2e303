"""The mesh a user gives, checked."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.convex_part import SHEET_M
from placement_planner_ros.core.body.mesh_components import Triangles
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.types import Array

MAX_TRIANGLES = 300_000
"""Triangles that an object may have, each with vertices of its own at most."""

MAX_PIECES = 500
"""Pieces that a mesh may have, or be cut into."""


def checked_mesh(
    vertices: npt.ArrayLike, triangles: npt.ArrayLike, scale: float, max_extent: float
) -> tuple[Array, Triangles]:
    """The mesh (m, 3) in metres and (t, 3), without the vertices that no triangle has.

    Raises:
        ObjectError: empty, too many triangles, not finite, bad indices, implausibly large or small.
    """
    if not (math.isfinite(scale) and scale > 0.0):
        raise ObjectError("`scale`", scale, "give a finite number above 0")
    try:
        points = np.array(vertices, dtype=np.float64)
        faces = np.array(triangles)
    except (TypeError, ValueError) as error:
        raise ObjectError("object", "mesh", "give numbers of shape (m, 3) and (t, 3)") from error
    # Shapes and indices.
    for name, array in (("vertices", points), ("triangles", faces)):
        if array.size == 0:
            raise ObjectError("object", f"no {name}", "the mesh is empty")
        if array.ndim != 2 or array.shape[1] != 3:
            raise ObjectError(f"`{name}`", array.shape, "give shape (n, 3)")
    if not np.issubdtype(faces.dtype, np.integer):
        raise ObjectError("`triangles`", faces.dtype, "give integers")
    bad = faces[(faces < 0) | (faces >= len(points))]
    if bad.size:
        what = f"is no index of one of {len(points)} vertices"
        raise ObjectError("`triangles`", int(bad[0]), what)
    require_few(len(points), len(faces))
    # Of vertices that triangles have: finite numbers, and a size that objects have.
    kept, made = np.unique(faces.astype(np.int64), return_inverse=True)
    used = points[kept]
    if odd := int((~np.isfinite(used).all(axis=1)).sum()):
        raise ObjectError("`vertices`", f"{odd} of them NaN or infinite", "give finite numbers")
    with np.errstate(over="ignore"):
        across = float((used.max(axis=0) - used.min(axis=0)).max()) * scale
    remedy = "look at its numbers and `scale`"
    if across > max_extent:
        if scale == 1.0 and 0.001 * across <= max_extent:
            remedy = "a mesh in millimetres needs `scale` 0.001"
        what = f"is larger than {max_extent} m; {remedy}"
        raise ObjectError("object", f"{across:.4g} m across", what)
    if across < SHEET_M:
        what = f"is too small, less than {SHEET_M:g} m; {remedy}"
        raise ObjectError("object", f"{across:.4g} m across", what)
    return used * scale, made.reshape(-1, 3)


def require_few(vertices: int, triangles: int) -> None:
    """Refuse meshes too large to plan with.

    Raises:
        ObjectError: more triangles than `MAX_TRIANGLES`, or more vertices than these can have.
    """
    limits = ("vertices", vertices, 3 * MAX_TRIANGLES), ("triangles", triangles, MAX_TRIANGLES)
    for name, count, most in limits:
        if count > most:
            what = f"an object may have {most}; simplify its mesh"
            raise ObjectError(f"`{name}`", f"{count} of them", what)


def checked_center(center_of_mass: npt.ArrayLike, scale: float) -> Array:
    """The centre of mass (3,) in metres.

    Raises:
        ObjectError: not three finite numbers.
    """
    try:
        center = np.array(center_of_mass, dtype=np.float64) * scale
    except (TypeError, ValueError):
        center = np.empty(0)
    if center.shape != (3,) or not np.isfinite(center).all():
        raise ObjectError("`center_of_mass`", center_of_mass, "give three finite numbers")
    return center
