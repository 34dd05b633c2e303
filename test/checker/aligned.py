"""How far the longest side of an object's foot is from running along what is nearest to it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial import ConvexHull

from .outlines import ends, outlines
from .stance import standing_along
from .surface import feet_of
from .task import Array, Task, Tolerances, world_vertices

_FARTHER, _FARTHEST, _APART = 0.01, 0.05, 0.018
_PLAIN = 0.5
_NOISE, _PER_DISAGREEMENT, _MOST = 0.03, 0.6, 0.4
"""Share of the outlines around, by weight, that a cloud may show otherwise: where all run in one
direction, what comes to it as they do not, and at most. What is shown elsewhere, or not, changes
little where the others say the same."""
_LEAST_LEFT = 0.45
"""What may be left of |F|, as squares of a grid make outlines ragged, the one way as the other."""
_SLACK = 0.02
"""rad to which outlines of things that are turned against the grid are known in nine of ten places,
as cells of 1 cm show them; 0.044 in 99 of 100."""
_ROUND = 12
"""So many longest sides are a circle's, along any of which the longest edge may run."""


def aligned_bounds(task: Task, T: Array, tolerances: Tolerances) -> tuple[float, float]:
    """Least and greatest value of `aligned` of a pose (4, 4), by the true solids' outlines.

    For each longest side of the foot, and outlines of which a share was seen otherwise, or all of
    which are ragged.
    """
    feet = feet_of(world_vertices(task, T), standing_along(task, T, tolerances), tolerances)
    ring = feet[ConvexHull(feet[:, :2]).vertices, :2]
    ways, most = _ways(task, ring.mean(axis=0), float(feet[:, 2].mean()))
    if not most:
        return 0.0, 0.0
    mean = ways / most
    share = min(_NOISE + _PER_DISAGREEMENT * (1.0 - abs(mean)), _MOST)
    turns = np.exp(2j * np.pi * np.arange(48) / 48)
    seen_otherwise = mean + np.linspace(0.0, share, 4)[:, None] * turns
    ragged = mean * np.linspace(_LEAST_LEFT, 1.0, 5)[:, None] + _NOISE * turns
    disturbed = np.concatenate([seen_otherwise, ragged]).ravel()
    values = [
        -0.25 * np.arccos(np.clip(cosines, -1.0, 1.0))
        for angle in _longest(ring)
        for cosines in [
            (disturbed * np.exp(-4j * angle)).real / np.maximum(np.abs(disturbed), _PLAIN)
        ]
    ]
    if len(values) >= _ROUND:
        return -0.25 * math.pi, 0.0
    return float(np.min(values)) - _SLACK, float(np.max(values)) + _SLACK


def _longest(ring: Array) -> Iterator[float]:
    """The angle of each side that is about the longest."""
    sides = np.roll(ring, -1, axis=0) - ring
    lengths = np.linalg.norm(sides, axis=1)
    for x, y in sides[lengths > 0.99 * lengths.max()]:
        yield math.atan2(y, x)


def _ways(task: Task, middle: Array, height: float) -> tuple[complex, float]:
    """F and W around a middle (2,) of what stands at a height."""
    size = float(np.linalg.norm(np.ptp(np.asarray(task.object_vertices), axis=0)))
    found = [*outlines(task, height + 0.01, height + size), *ends(task, height)]
    places = np.concatenate(found) @ [1.0, 1j] if found else np.zeros(0, complex)
    away = np.abs(places - middle @ [1.0, 1j])
    if not len(places):
        return 0j, 0.0
    near = away <= away.min() + _FARTHEST
    reached = places[away <= away.min() + _FARTHEST + _APART]
    ways = reached[None] - places[near][:, None]
    lengths = np.where(np.abs(ways) <= _APART, np.abs(ways), 0.0)
    means = (lengths * np.exp(4j * np.angle(ways))).sum(axis=1) / lengths.sum(axis=1)
    weights = np.exp(-(away[near] - away.min()) / _FARTHER)
    return complex(weights @ means), float(weights.sum())
