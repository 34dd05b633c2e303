"""What rises under an object between what it stands on: ribs, coins, waves of cloth."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.placement_face import PlacementFace
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.stability.one_plane import LEANS
from placement_planner_ros.core.types import Array, Slope

_RISES = 1.6
"""Times the noise of heights by which single surfaces under an object may be above their plane."""
_LEVEL = 2e-4
"""m by which heights of one level surface may differ."""
_FEW, _ALONE = 4, 3.0
"""Surfaces of fewer points than that lie as these were measured: times the noise, over the root of
their number, by which they may be above it."""
_BESIDE = 0.0025
"""m, half of what points that touch are apart: what lies so near to one is under the object."""


class Rises:
    """Whether something under an object lifts it off what is taken to carry it.

    Args:
        environment: its surfaces.
        tolerance: m above the contact plane up to which they count; with what is higher the object
            collides.
    """

    def __init__(self, environment: Environment, tolerance: float) -> None:
        self._environment = environment
        self._tolerance = tolerance
        self._heights: dict[Slope, Array] = {}

    def lift(
        self,
        touching: Array,
        face: PlacementFace,
        T: Array,
        slope: Slope,
        planes: Array,
        widths: Array,
        noise: Array,
    ) -> npt.NDArray[np.bool_]:
        """(n,) whether something lifts the object on one of its faces, at poses (n, 4, 4).

        On what is higher in its middle by d an object leans by d over half its width. That may be
        as much as in `in_one_plane`.

        Args:
            touching: (k, 2) of the object that lie in the plane of that face, in its frame.
            planes: (n, 3) the plane of what carries it: m above the contact plane at the origin of
                that frame, and by how much it rises along its axes.
            widths: (n,) m across what carries it, where that is narrowest.
            noise: (n,) m, of heights.
        """
        support = self._environment.support_of(slope)
        if slope not in self._heights:
            self._heights[slope] = np.sort(support.height)
        low = planes.copy()
        excused = _RISES * noise
        low[:, 0] += 0.5 * LEANS * widths + excused + _LEVEL
        placed = T @ face.T_face_object.inverse().homogeneous
        z = placed[:, 2, 3] - placed[:, :2, 3] @ np.array(slope)
        far = np.linalg.norm(touching, axis=1).max(initial=0.0)
        least = z + low[:, 0] - far * np.hypot(low[:, 1], low[:, 2])
        heights = self._heights[slope]
        between = [np.searchsorted(heights, at, "right") for at in (least, z + self._tolerance)]
        found = np.asarray(between[1] > between[0])
        rows = np.flatnonzero(found)
        if len(rows):
            found[rows] = _rise(
                touching,
                np.ascontiguousarray(placed[rows]),
                slope,
                low[rows],
                excused[rows],
                _ALONE * support.noise,
                self._tolerance,
                support.origin,
                support.cell_size,
                support.columns,
                support.start,
                support.height,
                support.rectangle,
                support.first,
            )
        return found


@kernel(nogil=True)
def _rise(
    touching: Array,
    placed: Array,
    slope: tuple[float, float],
    low: Array,
    excused: Array,
    alone: float,
    high: float,
    origin: Array,
    size: float,
    shape: tuple[int, int],
    start: npt.NDArray[np.int64],
    height: Array,
    rectangle: Array,
    first: npt.NDArray[np.int64],
) -> npt.NDArray[np.bool_]:
    """(n,) whether some surface lies above the plane that an object stands on, and under it.

    Args:
        touching: (k, 2) points of the object that lie in its contact plane, in a frame there.
        placed: (n, 4, 4) of that frame in the world.
        slope: of the contact plane.
        low: (n, 3) from which on a surface counts: m above the contact plane at the origin of that
            frame, and by how much more along its axes.
        high: m above the contact plane up to which it does.
        excused: (n,) m of that for noise.
        alone: m that it is for a surface of one point, where that is more.
        origin, size, shape, start, height, rectangle, first: of the `SupportMap` for that slope.
    """
    result = np.zeros(len(placed), np.bool_)
    for n in range(len(placed)):
        T = placed[n]
        for k in range(len(touching)):
            a, b = touching[k, 0], touching[k, 1]
            x = T[0, 0] * a + T[0, 1] * b + T[0, 3]
            y = T[1, 0] * a + T[1, 1] * b + T[1, 3]
            i, j = math.floor((x - origin[0]) / size), math.floor((y - origin[1]) / size)
            if not (0 <= i < shape[0] and 0 <= j < shape[1]):
                continue
            z = T[2, 0] * a + T[2, 1] * b + T[2, 3] - slope[0] * x - slope[1] * y
            from_there = low[n, 0] + low[n, 1] * a + low[n, 2] * b
            column = i * shape[1] + j
            for s in range(start[column], start[column + 1]):
                above = height[s] - z
                least, number = from_there, max(1, first[s + 1] - first[s])
                if number < _FEW:
                    least += max(0.0, alone / math.sqrt(number) - excused[n])
                if (
                    least < above <= high
                    and rectangle[s, 0] - _BESIDE <= x <= rectangle[s, 2] + _BESIDE
                    and rectangle[s, 1] - _BESIDE <= y <= rectangle[s, 3] + _BESIDE
                ):
                    result[n] = True
                    break
            if result[n]:
                break
    return result
