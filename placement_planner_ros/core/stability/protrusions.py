"""Protrusions under an object between its contacts: ribs, coins, waves of cloth."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.placement_face import PlacementFace
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.stability.coplanarity import MAX_LEAN_SLOPE
from placement_planner_ros.core.types import Array, Slope

_RISE_NOISES = 1.6
"""Times the noise of heights by which single surfaces under an object may be above their plane."""
_LEVEL_SPREAD_M = 2e-4
"""m by which heights of one level surface may differ."""
_FEW_POINTS, _POINT_NOISES = 4, 3.0
"""Surfaces of fewer points than that lie as these were measured: times the noise, over the root of
their number, by which they may be above it."""
_CONTACT_RADIUS_M = 0.0025
"""m, half of what points that touch are apart: what lies so near to one is under the object."""


class Protrusions:
    """Whether something under an object lifts it off what is taken to carry it.

    Args:
        environment: its surfaces.
        faces: on which the object may stand.
        touching: (k, 2) points of the object that lie in the plane of one of these, in its frame;
            asked for once where something is in the way.
        tolerance: m above the contact plane up to which surfaces count; with what is higher the
            object collides.
    """

    def __init__(
        self,
        environment: Environment,
        faces: Sequence[PlacementFace],
        touching: Callable[[int], Array],
        tolerance: float,
    ) -> None:
        self._environment = environment
        inward = [face.T_face_object.inverse() for face in faces]
        self._inward = np.array([T.homogeneous for T in inward]).reshape(-1, 4, 4)
        corners = [face.vertices - T.translation for face, T in zip(faces, inward, strict=True)]
        self._reach = np.array([np.linalg.norm(each, axis=1).max() for each in corners])
        self._touching = functools.cache(touching)
        self._tolerance = tolerance
        self._heights: dict[Slope, Array] = {}

    def lift(
        self,
        T: Array,
        faces: npt.NDArray[np.int64],
        slope: Slope,
        planes: Array,
        widths: Array,
        noise: Array,
    ) -> npt.NDArray[np.bool_]:
        """(n,) whether something lifts the object at poses (n, 4, 4) on these faces (n,).

        On what is higher in its middle by d an object leans by d over half its width. That may be
        as much as in `coplanar_support`.

        Args:
            slope: of the contact planes.
            planes: (n, 3) of what carries: m above the contact plane at the origin of the frame of
                each face, and by how much more along its axes.
            widths: (n,) m across what carries, where that is narrowest.
            noise: (n,) m, of heights.
        """
        support = self._environment.support_of(slope)
        if slope not in self._heights:
            self._heights[slope] = np.sort(support.height)
        excused = _RISE_NOISES * noise
        low = 0.5 * MAX_LEAN_SLOPE * widths + planes[:, 0] + excused + _LEVEL_SPREAD_M
        frames = T @ self._inward[faces]
        z = frames[:, 2, 3] - slope[0] * frames[:, 0, 3] - slope[1] * frames[:, 1, 3]
        least = z + low - self._reach[faces] * (np.abs(planes[:, 1]) + np.abs(planes[:, 2]))
        heights = self._heights[slope]
        found = heights.searchsorted(z + self._tolerance, "right") > heights.searchsorted(least)
        rows = np.flatnonzero(found)
        lowest = np.column_stack([low, planes[:, 1:]])
        for face in np.unique(faces[rows]):
            on = rows[faces[rows] == face]
            found[on] = _find_protrusions(
                self._touching(int(face)),
                frames[on],
                slope,
                lowest[on],
                excused[on],
                _POINT_NOISES * support.noise,
                self._tolerance,
                (support.origin, support.cell_size, support.columns),
                (support.start, support.height, support.rectangle, support.first),
            )
        return np.asarray(found)


@kernel(nogil=True)
def _find_protrusions(
    touching: Array,
    frames: Array,
    slope: tuple[float, float],
    lowest: Array,
    excused: Array,
    alone: float,
    high: float,
    grid: tuple[Array, float, tuple[int, int]],
    surfaces: tuple[npt.NDArray[np.int64], Array, Array, npt.NDArray[np.int64]],
) -> npt.NDArray[np.bool_]:
    """(n,) whether some surface lies above the plane that an object stands on, and under it.

    Args:
        touching: (k, 2) points of the object that lie in its contact plane, in a frame there.
        frames: (n, 4, 4) those of the contact planes, in the world.
        slope: of the contact planes.
        lowest: (n, 3) m above each from which on a surface counts: at the origin of its frame, and
            by how much more that is along its axes.
        excused: (n,) m of that for noise.
        alone: m that it is for a surface of one point, where that is more.
        high: m above the contact plane up to which it does.
        grid: origin, cell size and columns of the `SupportMap` for that slope.
        surfaces: start, height, rectangle and first of that.
    """
    origin, size, columns = grid
    start, height, rectangle, first = surfaces
    result = np.zeros(len(frames), np.bool_)
    for n in range(len(frames)):
        # The object's contact plane in the world.
        T = frames[n]
        # A point of the object that touches, and the column of the map below it.
        for k in range(len(touching)):
            a, b = touching[k, 0], touching[k, 1]
            x = T[0, 0] * a + T[0, 1] * b + T[0, 3]
            y = T[1, 0] * a + T[1, 1] * b + T[1, 3]
            i, j = math.floor((x - origin[0]) / size), math.floor((y - origin[1]) / size)
            if not (0 <= i < columns[0] and 0 <= j < columns[1]):
                continue
            # Height of the point above the plane through the origin that is parallel to the contact
            # plane.
            z = T[2, 0] * a + T[2, 1] * b + T[2, 3] - slope[0] * x - slope[1] * y
            # From which height above it a surface counts at this point.
            from_there = lowest[n, 0] + lowest[n, 1] * a + lowest[n, 2] * b
            column = i * columns[1] + j
            # The surfaces of the column.
            for s in range(start[column], start[column + 1]):
                above = height[s] - z
                # One of few measured points may be off by more.
                least, number = from_there, max(1, first[s + 1] - first[s])
                if number < _FEW_POINTS:
                    least += max(0.0, alone / math.sqrt(number) - excused[n])
                # It lifts the object where it is above the plane, below the end, and under the
                # point.
                if (
                    least < above <= high
                    and rectangle[s, 0] - _CONTACT_RADIUS_M
                    <= x
                    <= rectangle[s, 2] + _CONTACT_RADIUS_M
                    and rectangle[s, 1] - _CONTACT_RADIUS_M
                    <= y
                    <= rectangle[s, 3] + _CONTACT_RADIUS_M
                ):
                    result[n] = True
                    break
            if result[n]:
                break
    return result
