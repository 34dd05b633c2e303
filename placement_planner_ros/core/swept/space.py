"""All that an arm, its hand and the held object sweep along a path, against points of a cloud.

A cloud has hundreds of thousands of points, and all but a few lie far from the path or on what was
known when it was planned. So each point is put to these questions, until one answers no:

1. Is it in a cube of a grid that something sweeps? The cubes hold every point that comes nearer
   than the margin to any body at any time.
2. Is it news, that is, beyond the margin from every box of the obstacle set, or beyond its noise?
   The way keeps the margin from these boxes, so what is no news is not in the way.
3. Is the way certified with the news as the obstacle set, chord by chord, as edges are?

Nothing is built of all points, and the first two questions, in one pass over them, take some ten
nanoseconds each. None lets a point go that is news and comes nearer than the margin.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.arrays import ArmArrays
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M
from placement_planner_ros.core.reach.kinematics import chain_frames
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.core.swept.kernels import SweptCubes, find_news, mark_cubes
from placement_planner_ros.core.types import LEVEL, Array, Index, Slope, kernel_input

CHORD_MOTION_M = 0.02
"""m, how far a point of a body moves at most along a chord, unless between two samples; and the
edge of the grid's cubes."""
_CLUSTER_CELLS = 1.5
"""Cells of the obstacle set by which points that lie together differ at most along an axis."""
_KNOWN_SURFACE_NOISES = 5.0
"""Points within this times the noise of a surface that was known are no news."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """A part of a path: one arm with what it carries.

    Attributes:
        name: of the part, in words.
        arm: the arm, with the held object or without.
        configurations: (k, dof), k >= 1, so dense that the curve is straight in between.
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


@dataclass(frozen=True, slots=True, eq=False)
class _Chords:
    """A stretch in chords of little motion.

    Attributes:
        ends: (m + 1,) samples of the stretch where chords begin, and the last.
        middles: (m,) samples.
        reach: m that points of bodies get away from where they are at the middle of a chord.
        frames: (m, n + 2, 4, 4) at the middles.
    """

    ends: Index
    middles: Index
    reach: float
    frames: Array

    @classmethod
    def of(cls, arm: ArmArrays, configurations: Array) -> _Chords:
        frames = np.zeros((len(configurations), len(arm.prismatic) + 2, 4, 4))
        frames[:, -1] = np.eye(4)
        for q, placed in zip(kernel_input(configurations), frames, strict=True):
            chain_frames(arm.fixed, arm.prismatic, q, placed)
        # Where the chords end, by how far points move from sample to sample.
        along = np.concatenate([[0.0], np.cumsum(_largest_motions(arm, frames))])
        steps = np.arange(0.0, along[-1] + CHORD_MOTION_M, CHORD_MOTION_M)
        last = np.searchsorted(along, steps[1:], "right") - 1
        ends = np.unique([0, *last.tolist(), len(along) - 1])
        begin, end = (ends[:-1], ends[1:]) if len(ends) > 1 else (ends, ends)
        middles = (begin + end) // 2
        reach = np.maximum(along[end] - along[middles], along[middles] - along[begin])
        return cls(ends, middles, float(reach.max()), frames[middles])


class SweptSpace:
    """What is swept along the stretches of a path, and what was known when it was planned.

    Safe to use from several threads.

    Args:
        stretches: in the order in which they are run.
        known: the obstacle set.
        margin: that every body keeps from points, metres.
        density: how many points a cell of the obstacle set had, on average. So many points of news
            must lie together to count, up to `GridSettings.min_points`:
            fewer are flying pixels.
    """

    def __init__(
        self,
        stretches: Sequence[Stretch],
        known: ObstacleSet,
        margin: float,
        density: float = np.inf,
    ) -> None:
        self._stretches = tuple(stretches)
        self._margin = margin
        self._known = known.arrays
        # Points as near as that to what is known are no news.
        self._known_within = max(margin + BOUND_TOLERANCE_M, _KNOWN_SURFACE_NOISES * known.noise)
        self._fewest = int(min(GridSettings().min_points, density))
        self._chords = [_Chords.of(s.arm.arrays, s.configurations) for s in stretches]
        self._cubes = self._sweep()

    def news(self, points: Array) -> Index:
        """Rows of (n, 3) points that are swept, perhaps, and were not known."""
        rows = np.empty(len(points), dtype=np.int64)
        count = find_news(kernel_input(points), self._cubes, self._known, self._known_within, rows)
        return rows[:count]

    def first_hit(self, points: Array) -> Hit | None:
        """Which of (n, 3) points of `news` stands in the way, if enough of them lie together."""
        low = self._cubes.origin
        high = low + self._cubes.size * np.array(self._cubes.swept.shape)
        points = points[((points >= low) & (points <= high)).all(axis=1)]
        if len(points) and self._fewest > 1:
            company = KDTree(points).query_ball_point(
                points, _CLUSTER_CELLS * self._known.cell_size, p=np.inf, return_length=True
            )
            points = points[company >= self._fewest]
        as_they_are = GridSettings(self._known.cell_size, noise_floor=1.0, min_points=0)
        made: dict[bytes, ObstacleSet] = {}
        for stretch, chords in zip(self._stretches, self._chords, strict=True):
            # Points of its support do not count for the held object.
            height = points[:, 2] - points[:, :2] @ np.array(stretch.slope)
            above = height > stretch.contact
            for counted, contact in ((above, False), (~above, True)):
                if not counted.any():
                    continue
                key = counted.tobytes()
                if key not in made:
                    made[key] = ObstacleSet.from_points(points[counted], as_they_are)
                hit = self._hit_on(stretch, chords, made[key], contact)
                if hit is not None:
                    nearest = np.linalg.norm(points[counted] - hit.point, axis=1).argmin()
                    return replace(hit, point=points[counted][nearest])
        return None

    def _hit_on(
        self, stretch: Stretch, chords: _Chords, obstacles: ObstacleSet, contact: bool
    ) -> Hit | None:
        """Where a stretch cannot be certified against obstacles; None where it can."""
        settings = replace(stretch.arm.settings, collision_margin=self._margin)
        arm = stretch.arm.among(obstacles, settings)
        for a, b, deviation, middle in _straight_chords(stretch.configurations, chords):
            if arm.edge_free(a, b, contact=contact, deviation=deviation):
                continue
            # Where on the chord, as nearly as its ends and its middle tell.
            beyond = chords.reach + settings.edge_resolution
            for reserve, q in itertools.product((0.0, beyond), (middle, a, b)):
                met = arm.meeting(q, reserve, contact)
                if met is not None:
                    return Hit(met.where, stretch.name, met.first)
            return Hit(obstacles.lower[0], stretch.name, "the arm")
        return None

    def _sweep(self) -> SweptCubes:
        # A grid around all that is swept.
        reach = [self._margin + BOUND_TOLERANCE_M + chords.reach for chords in self._chords]
        lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
        for stretch, chords, beyond in zip(self._stretches, self._chords, reach, strict=True):
            for ball, centers, _ in _moving_balls(stretch.arm.arrays, chords.frames):
                lower = np.minimum(lower, centers.min(axis=0) - ball - beyond)
                upper = np.maximum(upper, centers.max(axis=0) + ball + beyond)
        shape = tuple(
            (np.floor(np.maximum(upper - lower, 0.0) / CHORD_MOTION_M) + 1.0).astype(int).tolist()
        )
        cubes = SweptCubes(lower, CHORD_MOTION_M, np.zeros(shape, dtype=np.bool_))
        # Mark the cubes of each stretch.
        for stretch, chords, beyond in zip(self._stretches, self._chords, reach, strict=True):
            mark_cubes(stretch.arm.arrays, chords.frames, beyond, cubes)
        return cubes


def _straight_chords(Q: Array, chords: _Chords) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Both ends of each chord of samples Q (k, dof), how far joints stray from it, its middle."""
    if len(Q) == 1:
        yield Q[0], Q[0], np.zeros(Q.shape[1]), Q[0]
        return
    for i, j, middle in zip(chords.ends[:-1], chords.ends[1:], chords.middles, strict=True):
        share = np.linspace(0.0, 1.0, j - i + 1)[:, None]
        strays = np.abs(Q[i : j + 1] - (Q[i] + share * (Q[j] - Q[i]))).max(axis=0)
        yield Q[i], Q[j], strays, Q[middle]


def _largest_motions(arm: ArmArrays, frames: Array) -> Array:
    """(k - 1,) how far points of bodies move at most from each of (k, n + 2, 4, 4) to the next.

    A point of the ball around a body moves no further than its centre, and the radius times the
    change of the rotation matrix; a turn by one angle has two equal singular values.
    """
    moved = np.zeros(len(frames) - 1)
    for radius, centers, rotations in _moving_balls(arm, frames):
        turned = np.sqrt(0.5 * np.square(np.diff(rotations, axis=0)).sum(axis=(1, 2)))
        far = np.linalg.norm(np.diff(centers, axis=0), axis=1)
        moved = np.maximum(moved, far + radius * turned)
    return moved


def _moving_balls(arm: ArmArrays, frames: Array) -> Iterator[tuple[float, Array, Array]]:
    """Radius, centres (k, 3) and rotations (k, 3, 3) of the ball around each body that moves."""
    for (joint, *_), ball in zip(arm.bodies[: arm.moving], arm.body_spheres, strict=False):
        rotations = frames[:, joint, :3, :3]
        yield float(ball[3]), rotations @ ball[:3] + frames[:, joint, :3, 3], rotations
