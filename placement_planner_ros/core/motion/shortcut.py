"""Random shortcutting of a certified path."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from placement_planner_ros.core.motion.birrt import GoalSetRRTSettings
from placement_planner_ros.core.motion.projected import (
    Constraint,
    ProjectedSteps,
    without_repetition,
)
from placement_planner_ros.core.types import Array

_CONSTRAINED_ATTEMPTS = 4
"""Times as many attempts along a constraint, whose shortcuts soon fail or are short."""


def shorten_path(
    path: Array,
    edge_is_free: Callable[[Array, Array], bool],
    rng: np.random.Generator,
    attempts: int = 50,
    should_stop: Callable[[], bool] = lambda: False,
    tries: int = 2,
    constraint: Constraint | None = None,
) -> Array:
    """Shorten a path by straight shortcuts between points on it, never making it longer.

    First vertices are skipped greedily (from each vertex to the furthest one a free edge reaches,
    trying at distances that halve), then shortcuts between two random points of the path are
    tried, wherever they lie on their edges. Last, vertices that the path can do without are left
    out: long edges leave room to round the corners between them, which time needs more than
    length. Shortcuts soon end on a path that none of them improves, which another order of them
    may miss; so the shortest of several independent tries is taken.

    Both ends stay exactly as they are. Every edge of the result is either part of an edge of
    `path` or was certified by `edge_is_free`; the part of a free edge is free. Along a constraint,
    shortcuts that leave it are projected back onto it, step by step.

    Args:
        path: (n, dof) waypoints, n ≥ 1, whose edges are free.
        edge_is_free: whether the whole straight motion between two configurations is free.
        rng: the only source of randomness.
        attempts: random shortcuts to try, all tries together.
        should_stop: asked before every edge; True returns what is reached so far.
        tries: among which the attempts are shared.
        constraint: what whole edges must keep; `edge_is_free` asks for it, too.

    Returns:
        (m, dof) waypoints.
    """
    path = np.array(path, dtype=np.float64)
    # Skip vertices first.
    points = _skip_vertices(list(without_repetition(path)), edge_is_free, should_stop)
    best = np.array(points)
    if len(points) < 3:
        return best
    # Along a constraint, shortcuts are walked.
    along = None
    if constraint is not None:
        along = ProjectedSteps(constraint, GoalSetRRTSettings().max_step)
        attempts *= _CONSTRAINED_ATTEMPTS
    # Independent tries, of which the shortest is taken.
    for child in rng.spawn(tries):
        if should_stop():
            break
        found = _cut_short(points, edge_is_free, child, attempts // tries, should_stop, along)
        if _path_length(found) < _path_length(best):
            best = found
    return best


def _cut_short(
    points: list[Array],
    edge_is_free: Callable[[Array, Array], bool],
    rng: np.random.Generator,
    attempts: int,
    should_stop: Callable[[], bool],
    along: ProjectedSteps | None,
) -> Array:
    """One try: random shortcuts, then the needless vertices left out."""
    for _ in range(attempts):
        if len(points) < 3 or should_stop():
            break
        # Two random points of the path, and the edges that they lie on.
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        reached = np.concatenate(([0.0], np.cumsum(lengths)))
        low, high = np.sort(rng.uniform(0.0, reached[-1], 2))
        i = min(int(np.searchsorted(reached, low, side="right")) - 1, len(lengths) - 1)
        j = min(int(np.searchsorted(reached, high, side="right")) - 1, len(lengths) - 1)
        if i == j:
            continue
        a = points[i] + (low - reached[i]) / lengths[i] * (points[i + 1] - points[i])
        b = points[j] + (high - reached[j]) / lengths[j] * (points[j + 1] - points[j])
        # Nothing is gained where the path is straight between them.
        straight_already = np.linalg.norm(b - a) >= (high - low) * (1.0 - 1e-9)
        if straight_already:
            continue
        # Replace what is between them by the edge, or by a walk along the constraint.
        if edge_is_free(a, b):
            points = [*points[: i + 1], a, b, *points[j + 1 :]]
        elif along is not None:
            way = _free_walk(along, a, b, high - low, edge_is_free)
            if way is not None:
                points = [*points[: i + 1], a, *way, *points[j + 1 :]]
    kept = _without_needless(list(without_repetition(points)), edge_is_free, should_stop)
    return np.array(kept)


def _free_walk(
    along: ProjectedSteps,
    a: Array,
    b: Array,
    length: float,
    edge_is_free: Callable[[Array, Array], bool],
) -> list[Array] | None:
    """Configurations from after `a` to `b` along the constraint, shorter by a hundredth."""
    way = along.walk(a, b, 0.99 * length)
    if way is None or len(way) == 1:
        return None
    edges = zip([a, *way], way, strict=False)
    return way if all(edge_is_free(p, q) for p, q in edges) else None


def _path_length(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _without_needless(
    points: list[Array],
    edge_is_free: Callable[[Array, Array], bool],
    should_stop: Callable[[], bool],
) -> list[Array]:
    """The points less those whose neighbours a free edge joins."""
    i = 1
    while i < len(points) - 1 and not should_stop():
        if edge_is_free(points[i - 1], points[i + 1]):
            del points[i]
        else:
            i += 1
    return points


def _skip_vertices(
    points: list[Array],
    edge_is_free: Callable[[Array, Array], bool],
    should_stop: Callable[[], bool],
) -> list[Array]:
    """Replace runs of edges by single free edges, longest first."""
    kept = [points[0]]
    i = 0
    while i < len(points) - 1:
        # The furthest vertex that a free edge reaches, at distances that halve.
        reach = len(points) - 1 - i
        while reach > 1 and (should_stop() or not edge_is_free(points[i], points[i + reach])):
            reach //= 2
        i += max(reach, 1)
        kept.append(points[i])
    return kept
