"""The curve a controller plays between timed points: one quintic per interval and joint.

A joint_trajectory_controller given positions, velocities and accelerations interpolates each
interval by the quintic that meets all three at both ends. Every bound here is taken on its Bézier
control points: the curve lies in their convex hull, so the bounds hold for the whole interval and
not only at samples.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import BPoly

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.types import ROUNDING, Array, Trajectory


def control_points(
    times: Array, positions: Array, velocities: Array, accelerations: Array
) -> Array:
    """Bézier control points (n-1, 6, dof) of the quintics between n timed points."""
    # Ends, and what velocities and accelerations move the inner points by.
    h = np.diff(times)[:, None]
    p, q = positions[:-1], positions[1:]
    v, w = 0.2 * h * velocities[:-1], 0.2 * h * velocities[1:]
    a, b = 0.05 * h**2 * accelerations[:-1], 0.05 * h**2 * accelerations[1:]
    return np.stack([p, p + v, p + 2.0 * v + a, q - 2.0 * w + b, q - w, q], axis=1)


def curve_points(trajectory: Trajectory) -> Array:
    """Bézier control points (n-1, 6, dof) of what a controller plays between its n points."""
    return control_points(
        trajectory.times, trajectory.positions, trajectory.velocities, trajectory.accelerations
    )


def positions_at(trajectory: Trajectory, t: Array) -> Array:
    """Positions (k, dof) at times t (k,); before the first and after the last point as there."""
    times = trajectory.times
    if len(times) == 1:
        return np.zeros((len(t), len(trajectory.joints))) + trajectory.positions[0]
    curve = BPoly(curve_points(trajectory).swapaxes(0, 1), times)
    return np.asarray(curve(np.clip(t, times[0], times[-1])))


def concatenate_trajectories(first: Trajectory, second: Trajectory) -> Trajectory:
    """`first`, then `second`, which starts where and as fast as `first` ends.

    The acceleration may jump there; the joint point keeps that of `first`, so it should be zero on
    both sides, as it is where `parameterize_path` starts and ends.

    Raises:
        ParameterError: the ends do not meet.
    """
    # Where both meet.
    for name in ("positions", "velocities", "accelerations"):
        end, start = getattr(first, name)[-1], getattr(second, name)[0]
        if not np.allclose(end, start, rtol=0.0, atol=ROUNDING):
            raise ParameterError(name, start.tolist(), f"must start at {end.tolist()}")
    return Trajectory(
        first.joints,
        np.concatenate([first.times, first.times[-1] + second.times[1:]]),
        np.concatenate([first.positions, second.positions[1:]]),
        np.concatenate([first.velocities, second.velocities[1:]]),
        np.concatenate([first.accelerations, second.accelerations[1:]]),
    )


def limit_ratio(points: Array, durations: Array, velocity: Array, acceleration: Array) -> float:
    """By what factor time must be stretched for both limits to hold on the whole curve.

    An upper bound within a few percent; below one where there is room.

    Args:
        points: (m, 6, dof) control points.
        durations: (m,) seconds.
        velocity, acceleration: (dof,) limits.
    """
    # Control points of quarter pieces, which lie close to the curve.
    h = np.repeat(durations, 4)[:, None, None] / 4.0
    points = halved_pieces(halved_pieces(points))
    # Those of the derivatives bound them.
    first = 5.0 * np.diff(points, axis=1) / h
    second = 4.0 * np.diff(first, axis=1) / h
    # Time stretched by a factor divides velocities by it and accelerations by its square.
    fastest = float(np.max(np.abs(first) / velocity))
    hardest = float(np.max(np.abs(second) / acceleration))
    return max(fastest, float(np.sqrt(hardest)))


def halved_pieces(points: Array) -> Array:
    """Both halves of each Bézier piece: (m, 6, dof) to (2 m, 6, dof) control points."""
    # De Casteljau's scheme in the middle: its first and last points are those of both halves.
    left, right = [points[:, 0]], [points[:, -1]]
    while points.shape[1] > 1:
        points = 0.5 * (points[:, :-1] + points[:, 1:])
        left.append(points[:, 0])
        right.append(points[:, -1])
    both = np.stack([np.stack(left, axis=1), np.stack(right[::-1], axis=1)], axis=1)
    return both.reshape(-1, len(left), both.shape[-1])


def chord_deviation(points: Array) -> tuple[Array, int]:
    """How far, joint by joint, a run of pieces strays from the chord between its ends.

    Args:
        points: (m, 6, dof) control points of consecutive pieces.

    Returns:
        (dof,) bound: every point of the curve is within it of some point of the chord; and the
        piece in which the furthest control point lies.
    """
    # Every control point against the nearest point of the chord.
    flat = points.reshape(-1, points.shape[-1]) - points[0, 0]
    chord = flat[-1]
    squared = float(chord @ chord)
    along = np.clip(flat @ chord / squared, 0.0, 1.0) if squared > 0.0 else np.zeros(len(flat))
    away = np.abs(flat - along[:, None] * chord)
    return away.max(axis=0) + ROUNDING, int(away.max(axis=1).argmax()) // points.shape[1]


def first_uncertified(
    points: Array,
    edge_free: Callable[[Array, Array, Array], bool],
    tolerance: float,
    finest: float = 1e-6,
) -> int | None:
    """Certify a curve by chords with slack.

    Runs of pieces within `tolerance` of their chord are asked for as one; where that is refused,
    the run is divided, which lessens the slack, until one piece is left that is within `finest`.

    Args:
        points: (m, 6, dof) control points of consecutive pieces.
        edge_free: (a, b, deviation) -> whether every motion that stays within `deviation` (dof,),
            joint by joint, of the straight motion from a to b is free.
        tolerance, finest: radians.

    Returns:
        None where the whole curve is certified, else the first piece that is not.
    """
    # Runs of pieces that are still to be certified, the first on top.
    stack = [(0, points)]
    while stack:
        index, run = stack.pop()
        # One edge with the run's deviation as slack.
        deviation, furthest = chord_deviation(run)
        largest = float(np.max(deviation))
        if largest <= tolerance and edge_free(run[0, 0], run[-1, -1], deviation):
            continue
        # Divide the run at its furthest piece, or in the middle where it is straight already.
        if len(run) > 1:
            middle = len(run) // 2 if largest <= finest else min(max(furthest, 1), len(run) - 1)
            stack += [(index + middle, run[middle:]), (index, run[:middle])]
        elif largest <= finest:
            return index
        else:
            # Divide the piece itself.
            halves = halved_pieces(run)
            stack += [(index, halves[1:]), (index, halves[:1])]
    return None
