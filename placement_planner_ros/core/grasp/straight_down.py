"""Deviation of the held object from the straight line on which it comes to its placement."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.reach.reach_bound import lever_arms
from placement_planner_ros.core.types import Array

_CHORD_DEVIATION_M = 1e-5
"""m, what a point may do between two samples beyond their chord."""
_BINOMIALS = np.array([math.comb(5, k) for k in range(6)])


UP = np.array([0.0, 0.0, 1.0])


class StraightLines(NamedTuple):
    """Lines on which vertices of the held object come to where they are placed."""

    vertices: Array
    """(n, 3) in the frame of the tip, metres."""
    placed: Array
    """(n, 3) where they are placed, in the world."""
    direction: Array = UP
    """(3,) unit, of the way back."""


def stray_at(chain: Chain, Q: Array, lines: StraightLines) -> float:
    """How far, at Q (k, dof), vertices are from their lines.

    Each line is as long as the vertex that has gone least far on its own at Q[0] has gone.

    Returns:
        the furthest, metres.
    """
    # The vertices at every configuration, from where they are placed.
    T = chain.forward_batch(Q)
    away = lines.vertices @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3] - lines.placed
    # What is left beside the line up to its end.
    gone = away @ lines.direction
    length = max(float(gone[0].min()), 0.0)
    away -= np.clip(gone, 0.0, length)[..., None] * lines.direction
    return math.sqrt(float(np.square(away).sum(axis=-1).max()))


def greatest_stray(chain: Chain, points: Array, lines: StraightLines) -> float:
    """`stray_at` at most on a whole curve.

    The curve is sampled, and between samples a point differs from their chord by at most
    h²/8 |p''|. Of two joints that both turn, the inner i and the outer j, the second derivative of
    a point at most ρ_j from the axis of j is z_i × (z_j × (p - o_j)), no longer than ρ_j; so
    |p''| ≤ Σ_j ρ_j |q_j''| + Σ_ij ρ_max(i,j) |q_i'| |q_j'|, with ρ_j = 1 where joint j slides.
    The distance from a line is convex: along a chord it is no more than at its ends.

    Args:
        points: (m, 6, dof) Bézier control points of the curve's pieces, from above to rest.

    Returns:
        metres, `_CHORD_DEVIATION_M` above the furthest that is reached at most.
    """
    # Bounds of the joints' first and second derivatives over each piece.
    reach = lever_arms(chain, lines.vertices)
    joints = np.arange(chain.dof)
    first = 5.0 * np.abs(np.diff(points, axis=1)).max(axis=1)
    second = 20.0 * np.abs(np.diff(points, 2, axis=1)).max(axis=1)
    # How far a point may bend away from a chord, and samples close enough for that.
    outer = reach[np.maximum.outer(joints, joints)]
    bend = second @ reach + np.einsum("mi,ij,mj->m", first, outer, first)
    counts = np.maximum(np.ceil(np.sqrt(bend / (8.0 * _CHORD_DEVIATION_M))), 1.0).astype(np.int64)
    Q = [_bezier_samples(piece, count) for piece, count in zip(points, counts, strict=True)]
    return stray_at(chain, np.vstack(Q), lines) + _CHORD_DEVIATION_M


def _bezier_samples(points: Array, count: int) -> Array:
    """(count + 1, dof) evenly along a piece (6, dof)."""
    s = np.linspace(0.0, 1.0, count + 1)[:, None]
    powers = np.arange(6)
    return np.asarray(_BINOMIALS * s**powers * (1.0 - s) ** (5 - powers) @ points)
