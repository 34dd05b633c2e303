"""Time parameterization: from a certified polyline to the curve a controller plays.

The polyline's corners are rounded, the speed along the rounded curve is made time-optimal under
the joints' velocity and acceleration limits (toppra, reachability analysis), averaged over a short
window so that accelerations are continuous, and sampled. What is published and certified is the
quintic between the samples (`quintic`), not the curve they were taken from.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import PPoly
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint
from toppra.interpolator import AbstractGeometricPath

from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.timing.carried_point import (
    CarriedPoint,
    PointAccelerationConstraint,
)
from placement_planner_ros.core.timing.quintic import (
    concatenate_trajectories,
    control_points,
    curve_points,
    first_uncertified,
    limit_ratio,
)
from placement_planner_ros.core.timing.rounding import (
    blend_control_points,
    largest_cuts,
    rounded_polyline,
)
from placement_planner_ros.core.types import ROUNDING, Array, Trajectory

EdgeFree = Callable[[Array, Array, Array], bool]

_BLENDING_ROUNDS = 12
"""Timed curves tried, each with smaller blends than the one before, the last with none."""
_BLEND_SIZES = 5
"""Sizes that a blend is tried at, each half of the one before."""


@dataclass(frozen=True, slots=True)
class CurveSettings(Settings):
    """How finely the timed curve is made.

    Attributes:
        blend_deviation: norm over the joints, by which a rounded corner may miss its waypoint.
        chord_tolerance: by which pieces of the curve may stray from the chords that are certified
            for them, joint by joint.
        smoothing_time: over which the path speed is averaged; bounds the jerk.
        max_interval: between two points at most, as long as `max_points` allows it.
        max_points: points of a trajectory at most, per stretch between two stops.
    """

    blend_deviation: float = setting(0.2, "(0, inf)", "rad")
    chord_tolerance: float = setting(1e-3, "(0, inf)", "rad")
    smoothing_time: float = setting(0.08, "(0, inf)", "s")
    max_interval: float = setting(0.05, "(0, inf)", "s")
    max_points: int = setting(2000, "[10, inf)")


def parameterize_path(
    path: Array,
    joints: Sequence[str],
    limits: Array,
    edge_free: EdgeFree,
    should_stop: Callable[[], bool] = lambda: False,
    carried: CarriedPoint | None = None,
) -> Trajectory | None:
    """Time a path from rest to rest, and certify the timed curve.

    Corners are rounded as far as `blend_deviation` and `edge_free` allow; where they do not, the
    motion stops at the waypoint. Both limits hold on the whole quintic interpolation. The curve
    starts exactly at `path[0]` and ends exactly at `path[-1]`, both with zero velocity and
    acceleration.

    Args:
        path: (n, dof) waypoints, n ≥ 1. Waypoints within 1e-9 of their predecessor are left out.
        joints: names, in column order.
        limits: (2, dof) of velocity and acceleration, finite and above zero.
        edge_free: (a, b, deviation) -> whether every motion that stays within `deviation` (dof,),
            joint by joint, of the straight motion from a to b is free.
        should_stop: asked before every edge and every timing, which takes some 10 ms.
        carried: a point whose acceleration is limited, too, on the whole curve.

    Returns:
        The trajectory; of a path that does not move, its one point. None where no timed curve
        could be certified (even with a stop at every waypoint), or where it was stopped.
    """
    settings, limits = CurveSettings(), np.array(limits, dtype=np.float64)
    path = np.array(path, dtype=np.float64)
    # A path that does not move is its one point.
    waypoints = _distinct_waypoints(path)
    if len(waypoints) == 1:
        still = np.zeros_like(waypoints)
        return Trajectory(tuple(joints), np.zeros(1), waypoints, still, still)

    def free_until_stopped(a: Array, b: Array, deviation: Array) -> bool:
        return not should_stop() and edge_free(a, b, deviation)

    # The largest blends first; of a corner whose curve is refused half, then none.
    cuts = largest_cuts(waypoints, settings.blend_deviation)
    refused = np.zeros(len(cuts), dtype=bool)
    for round_ in range(_BLENDING_ROUNDS):
        # The second round asks for each blend alone, the last one stops at every waypoint.
        if round_ == 1:
            cuts = _certified_cuts(waypoints, cuts, free_until_stopped, settings)
        elif round_ == _BLENDING_ROUNDS - 1:
            cuts = np.zeros_like(cuts)
        if should_stop():
            return None
        timed = _timed_curve(waypoints, cuts, tuple(joints), limits, settings, carried)
        if timed is None:
            return None
        # Certify the curve piece by piece.
        points = curve_points(timed)
        failed = first_uncertified(points, free_until_stopped, settings.chord_tolerance)
        if failed is None:
            return timed
        # The corner nearest to the piece that was refused.
        distance = np.linalg.norm(waypoints - points[failed].mean(axis=0), axis=1)
        distance[cuts == 0.0] = np.inf
        corner = int(distance.argmin())
        length = float(np.linalg.norm(points[failed, -1] - points[failed, 0]))
        if distance[corner] > 2.0 * (cuts[corner] + length):
            return None  # a straight part: no smaller blend would help
        if round_ > 0:  # halve the blend once, then stop there
            cuts[corner] = 0.0 if refused[corner] else 0.5 * cuts[corner]
            refused[corner] = True
    return None


def _distinct_waypoints(path: Array) -> Array:
    """The waypoints less those that repeat their predecessor; both ends stay exact."""
    kept = [path[0]]
    for q in path[1:]:
        if np.linalg.norm(q - kept[-1]) > ROUNDING:
            kept.append(q)
    if len(kept) > 1:
        kept[-1] = path[-1]
    return np.array(kept)


def _certified_cuts(
    waypoints: Array, cuts: Array, edge_free: EdgeFree, settings: CurveSettings
) -> Array:
    """Per corner the largest of a few halvings of its cut whose blend is free; 0 where none is."""
    certified = cuts.copy()
    for corner in np.flatnonzero(cuts):
        for _ in range(_BLEND_SIZES):
            # The blend with this cut alone.
            blend = blend_control_points(waypoints, certified, int(corner))[None]
            if first_uncertified(blend, edge_free, settings.chord_tolerance) is None:
                break
            certified[corner] *= 0.5
        else:
            certified[corner] = 0.0
    return certified


def _timed_curve(
    waypoints: Array,
    cuts: Array,
    joints: tuple[str, ...],
    limits: Array,
    settings: CurveSettings,
    carried: CarriedPoint | None,
) -> Trajectory | None:
    """The timed curve; at rest at both ends and where cuts are 0."""
    timed: Trajectory | None = None
    # From stop to stop.
    for i, j in pairwise(np.flatnonzero(cuts == 0.0)):
        among = slice(i, j + 1)
        stretch = _timed_stretch(waypoints[among], cuts[among], limits, settings, carried)
        if stretch is None:
            return None
        piece = Trajectory(joints, *stretch)
        timed = piece if timed is None else concatenate_trajectories(timed, piece)
    return timed


def _timed_stretch(
    waypoints: Array,
    cuts: Array,
    limits: Array,
    settings: CurveSettings,
    carried: CarriedPoint | None,
) -> tuple[Array, Array, Array, Array] | None:
    """One stretch from rest to rest; sampled more finely where that makes it faster."""
    # The time-optimal profile, on finer grids where none is found.
    curve = rounded_polyline(waypoints, cuts)
    grids = (_path_grid(curve, refinement) for refinement in (1, 2, 4))
    profiles = (_fastest_profile(curve, grid, limits, carried) for grid in grids)
    profile = next((each for each in profiles if each is not None), None)
    if profile is None:
        return None
    # How far the jerk is smoothed, and between how many points.
    times, s, speed = profile
    window = min(settings.smoothing_time, 0.2 * times[-1])
    duration = times[-1] + window
    interval = min(settings.max_interval, 0.5 * window)
    best: tuple[float, tuple[Array, ...]] = (np.inf, ())
    for finer in (1, 2, 4):
        count = min(int(np.ceil(finer * duration / interval)) + 1, settings.max_points)
        # Sample the smoothed motion.
        t = np.linspace(0.0, duration, count)
        timed = _sampled_curve(curve, t, *_averaged_position(times, s, speed, t, window))
        timed[1][[0, -1]] = waypoints[[0, -1]]
        # By how much it exceeds the limits, and the limit of the point that is carried.
        points, durations = control_points(*timed), np.diff(t)
        ratio = limit_ratio(points, durations, limits[0], limits[1])
        if carried is not None:
            hardest = carried.largest_acceleration(points, durations) / carried.limit
            ratio = max(ratio, float(np.sqrt(hardest)))
        if ratio < best[0]:
            best = ratio, timed
        if ratio < 1.05:
            break
    # Slow the best down until all limits hold.
    stretch, (t, q, v, a) = best[0] * (1.0 + 1e-9), best[1]
    return t * stretch, q, v / stretch, a / stretch**2


class _Geometry(AbstractGeometricPath):
    """A piecewise polynomial as toppra reads paths."""

    def __init__(self, curve: PPoly) -> None:
        self._derivatives = (curve, curve.derivative(1), curve.derivative(2))

    def __call__(self, path_positions: Array, order: int = 0) -> Array:
        return np.asarray(self._derivatives[order](path_positions))

    @property
    def dof(self) -> int:
        return int(self._derivatives[0].c.shape[2])

    @property
    def path_interval(self) -> Array:
        return np.asarray(self._derivatives[0].x[[0, -1]])


def _path_grid(curve: PPoly, refinement: int) -> Array:
    """Path positions for toppra: some on every piece, more on long ones and where it turns far."""
    breaks = curve.x
    turns = np.linalg.norm(np.diff(curve(breaks, 1), axis=0), axis=1)
    shares = np.diff(breaks) / breaks[-1]
    counts = refinement * (2 + (20.0 * shares).astype(int) + (4.0 * turns).astype(int))
    # Evenly within each piece.
    ends = zip(pairwise(breaks), counts.tolist(), strict=True)
    pieces = [np.linspace(a, b, count + 1)[1:] for (a, b), count in ends]
    return np.concatenate([breaks[:1], *pieces])


def _fastest_profile(
    curve: PPoly, grid: Array, limits: Array, carried: CarriedPoint | None
) -> tuple[Array, Array, Array] | None:
    """Times, path positions and path speeds (k,) of the time-optimal motion from rest to rest."""
    constraints = [*_joint_constraints(limits.tobytes())]
    if carried is not None:
        constraints.append(PointAccelerationConstraint(carried))
    # Speeds at the grid points, as fast as the limits allow.
    solver = TOPPRA(constraints, _Geometry(curve), gridpoints=grid, solver_wrapper="seidel")
    _, speed, _ = solver.compute_parameterization(0.0, 0.0)
    if speed is None or not np.isfinite(speed).all():
        return None
    # Between two points the speed is linear in time.
    mean = 0.5 * (speed[:-1] + speed[1:])
    if not (mean > 0.0).all():
        return None
    return np.concatenate([[0.0], np.cumsum(np.diff(grid) / mean)]), grid, np.asarray(speed)


@lru_cache
def _joint_constraints(limits: bytes) -> tuple[Any, ...]:
    """For limits (2, dof) as toppra has them, which take as long to make as to use."""
    velocity, acceleration = np.frombuffer(limits).reshape(2, -1)
    return JointVelocityConstraint(velocity), JointAccelerationConstraint(acceleration)


def _averaged_position(
    times: Array, s: Array, speed: Array, t: Array, window: float
) -> tuple[Array, Array, Array]:
    """s(t) averaged over the last `window` seconds, with its first and second derivative (k,).

    s is quadratic between `times`; the average of a motion from rest to rest is one too, lasts
    longer by `window`, and its acceleration is continuous.
    """
    # The position as a piecewise parabola, its integral and its derivative.
    steps = np.diff(times)
    position = PPoly(np.stack([0.5 * np.diff(speed) / steps, speed[:-1], s[:-1]]), times)
    area = position.antiderivative()
    velocity = position.derivative()

    def at(x: Array) -> tuple[Array, Array, Array]:
        x = np.maximum(x, 0.0)
        inside = np.minimum(x, times[-1])
        moving = (x > 0.0) & (x < times[-1])
        over = x - inside
        return area(inside) + over * s[-1], position(inside), np.where(moving, velocity(inside), 0)

    # The mean over the window, and its derivatives.
    now, before = at(t), at(t - window)
    value, first, second = ((a - b) / window for a, b in zip(now, before, strict=True))
    first[[0, -1]] = second[[0, -1]] = 0.0
    return np.clip(value, s[0], s[-1]), first, second


def _sampled_curve(
    curve: PPoly, t: Array, s: Array, first: Array, second: Array
) -> tuple[Array, Array, Array, Array]:
    """The curve at s(t): times, positions, velocities and accelerations."""
    # By the chain rule.
    tangent = curve(s, 1)
    velocities = tangent * first[:, None]
    accelerations = curve(s, 2) * (first**2)[:, None] + tangent * second[:, None]
    return t, curve(s), velocities, accelerations
