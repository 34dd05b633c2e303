"""All that an arm, its hand and the held object sweep along a path, against points of a cloud.

A cloud has hundreds of thousands of points, and all but a few lie far from the path or on what was
known when it was planned. So each point is put to these questions, until one answers no:

1. Is it in a cube of a grid that something sweeps? The cubes hold every point that comes nearer
   than the margin to any body at any time, and say when: from which mark of the path to which.
2. Is it news, that is, beyond the margin from every box of the obstacle set, or beyond its noise?
   The way keeps the margin from these boxes, so what is no news is not in the way.
3. Is it nearer than the margin to a body? Asked at configurations between which no point of a body
   moves further than `MOTION_BETWEEN_M`, of the margin and about half of that.

Nothing is built of the points, and the first two questions, in one pass over all of them, take some
ten nanoseconds each. They never let a point go that is news and comes nearer than the margin; the
third may call one near that is `MOTION_BETWEEN_M` beyond it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.arrays import ArmArrays
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.swept.kernels import (
    BLOCK_CONFIGURATIONS,
    SweptCubes,
    SweptPath,
    extend_corners,
    find_hit,
    find_news,
    largest_motions,
    mark_cubes,
    place_all,
)
from placement_planner_ros.core.types import LEVEL, Array, Slope

MOTION_BETWEEN_M = 0.002
"""m, how far a point of a body moves at most between configurations that are looked at."""
_HALF_WAY_SHARE = 0.52
"""Of that, that a point may be from where it is at the nearer of the two; a little more than half,
as its way is not quite straight."""
_CUBE_EDGE_M = 0.02
"""m, edge of the grid's cubes, ..."""
_MOST_CUBES = 1_000_000
"""... unless there were more than these."""
_CLUSTER_CELLS = 1.5
"""Cells of the obstacle set by which points that lie together differ at most along an axis."""
_CLUSTER_POINTS = 5
"""Points of news that lie together before they count; fewer are flying pixels, ..."""
_SPARSE_POINTS_PER_CELL = 4.0
"""... unless there are fewer points than this in a cell: then each of them counts."""
_KNOWN_SURFACE_NOISES = 5.0
"""Points within this times the noise of a surface that was known are no news."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """A part of a path: one arm with what it carries.

    Attributes:
        name: of the part, in words.
        arm: the arm, with the held object or without.
        configurations: (k, dof), k >= 1, from `even_times`.
        contact: m, up to this height points do not count for the held object: its support.
        slope: of that height, which is the one at x = y = 0.
    """

    name: str
    arm: ArmCollision
    configurations: Array
    contact: float = -np.inf
    slope: Slope = LEVEL


@dataclass(frozen=True, slots=True, eq=False)
class Hit:
    """A point that stands in the way.

    Attributes:
        point: (3,) metres.
        stretch: the name of the part of the path.
        body: the link, or the held object.
    """

    point: Array
    stretch: str
    body: str


class SweptSpace:
    """What is swept along the stretches of a path, and what was known when it was planned.

    Safe to use from several threads.

    Args:
        stretches: in the order in which they are run.
        known: the obstacle set.
        margin: that every body keeps from points, metres.
        density: how many points a cell of the obstacle set had, on average.
    """

    def __init__(
        self,
        stretches: Sequence[Stretch],
        known: ObstacleSet,
        margin: float,
        density: float = np.inf,
    ) -> None:
        self._stretches = tuple(stretches)
        self._margin = margin + BOUND_TOLERANCE_M
        self._known = known.arrays
        # Points as near as that to what is known are no news, and how many must lie together.
        self._known_within = max(margin, _KNOWN_SURFACE_NOISES * known.noise)
        self._together = _CLUSTER_CELLS * known.cell_size
        self._fewest = _CLUSTER_POINTS if density >= _SPARSE_POINTS_PER_CELL else 1
        self._paths = []
        marks = 0
        # Frames of each stretch, with half of the motion between two of them.
        for stretch in stretches:
            arrays = stretch.arm.arrays
            frames = _frames_along(arrays, stretch.configurations)
            slack = _HALF_WAY_SHARE * float(largest_motions(arrays, frames).max(initial=0.0))
            self._paths.append(
                SweptPath(arrays, frames, slack, stretch.contact, *stretch.slope, marks)
            )
            marks += -(-len(frames) // BLOCK_CONFIGURATIONS)
        self._cubes = self._sweep()

    def news(self, points: Array) -> npt.NDArray[np.int64]:
        """Rows of (n, 3) points that are swept, perhaps, and were not known."""
        rows = np.empty(len(points), dtype=np.int64)
        count = find_news(points, self._cubes, self._known, self._known_within, rows)
        return rows[:count]

    def first_hit(self, points: Array) -> Hit | None:
        """Which of (n, 3) points of `news` stands in the way, if enough of them lie together."""
        points, cubes = np.ascontiguousarray(points), self._cubes
        work = np.zeros((6, 4)), np.zeros((1, 3))
        for stretch, path in zip(self._stretches, self._paths, strict=True):
            row, body = find_hit(
                points, cubes, path, self._margin, self._together, self._fewest, work
            )
            if row >= 0:
                return Hit(points[row], stretch.name, stretch.arm.body_names[body])
        return None

    def _sweep(self) -> SweptCubes:
        # A grid around all that is swept.
        reach = [self._margin + path.slack * BLOCK_CONFIGURATIONS for path in self._paths]
        lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
        for path, beyond in zip(self._paths, reach, strict=True):
            extend_corners(path, beyond, lower, upper)
        sides = np.maximum(upper - lower, 1e-3)
        size = max(_CUBE_EDGE_M, float(np.cbrt(np.prod(sides) / _MOST_CUBES)))
        shape = tuple((np.floor(sides / size) + 1.0).astype(int).tolist())
        cubes = SweptCubes(
            lower, size, np.zeros(shape, dtype=np.int32), np.zeros(shape, dtype=np.int32)
        )
        # Mark the cubes of each stretch.
        for path, beyond in zip(self._paths, reach, strict=True):
            mark_cubes(path, beyond, cubes)
        return cubes


def even_times(arm: ArmCollision, coarse: Array, times: Array) -> Array:
    """Times (n,) at which a curve is to be looked at for a `Stretch`.

    Args:
        coarse: (k, dof) the curve at `times`, dense enough that it is straight in between.
        times: (k,).
    """
    # Times at even steps of the greatest motion.
    moved = largest_motions(arm.arrays, _frames_along(arm.arrays, coarse))
    along = np.concatenate([[0.0], np.cumsum(moved)])
    number = int(np.ceil(along[-1] / MOTION_BETWEEN_M))
    return np.asarray(np.interp(np.linspace(0.0, along[-1], number + 1), along, times))


def _frames_along(arm: ArmArrays, configurations: Array) -> Array:
    """(k, n + 2, 4, 4) joint frames at (k, dof)."""
    frames = np.zeros((len(configurations), len(arm.prismatic) + 2, 4, 4))
    frames[:, -1] = np.eye(4)
    place_all(arm, np.ascontiguousarray(configurations), frames)
    return frames
