"""How far points scatter about the curved surfaces that they are of.

A plane fitted to what is curved is off by that; a parabola of two variables, z = a + b x + c y +
d x² + e x y + f y², follows waves, cans and bent trays over a few centimetres.
"""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.scene.binning import Bins
from placement_planner_ros.core.types import Array

_SAMPLED = 200
"""Neighbourhoods looked at."""
_FEWEST = 16
"""Points of the smallest one; six of them are explained whatever they are."""
_FLAT = 0.6
"""Times as far as across its narrower side, at most, do a surface's points lie along its normal."""
_SURFACES = 0.2
"""Share of the neighbourhoods that must be surfaces, to say anything."""


def scatter_about_curved(bins: Bins, reach: int) -> Array:
    """(n,) standard deviations of the points around sampled cells about curved surfaces, metres;
    none where few of these look like surfaces.

    Args:
        reach: cells to each side of one whose points are its neighbourhood.
    """
    rows, first = _neighbourhoods(bins, reach)
    many = np.diff(np.append(first, len(rows)))
    all_of_them = len(many)
    kept = many >= _FEWEST
    rows, many = rows[np.repeat(kept, many)], many[kept]
    if not len(many):
        return np.zeros(0)
    first, of = np.cumsum(many) - many, np.repeat(np.arange(len(many)), many)
    points = bins.points[rows].astype(np.float64)
    points -= (np.add.reduceat(points, first) / many[:, None])[of]
    spread = np.add.reduceat(points[:, :, None] * points[:, None], first) / many[:, None, None]
    variances, axes = np.linalg.eigh(spread)  # the normal first
    surface = (variances[:, 1] > 0.0) & (variances[:, 0] < _FLAT**2 * variances[:, 1])
    if surface.sum() < _SURFACES * all_of_them:
        return np.zeros(0)
    along = np.einsum("nij,ni->nj", axes[of], points)
    unit = np.sqrt(np.maximum(variances[:, 2], 1e-12))
    z, x, y = (along / unit[of, None]).T
    terms = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    square = np.add.reduceat(terms[:, :, None] * terms[:, None], first)
    right = np.add.reduceat(terms * z[:, None], first)
    square += 1e-9 * many[:, None, None] * np.eye(6)  # points in two lines tell no parabola
    fitted = np.linalg.solve(square, right[:, :, None])[:, :, 0]
    left = z - np.einsum("nj,nj->n", terms, fitted[of])
    variance = np.add.reduceat(left * left, first) / (many - 6)
    return np.asarray((unit * np.sqrt(variance))[surface])


Rows = npt.NDArray[np.int64]


def _neighbourhoods(bins: Bins, reach: int) -> tuple[Rows, Rows]:
    """Rows (k,) of the points around sampled cells, one cell after the other; (n,) where each
    begins."""
    stride = max(1, len(bins.cells) // _SAMPLED)
    cells = bins.cells[::stride].astype(np.int64)
    steps = np.array(list(itertools.product(range(-reach, reach + 1), repeat=3)))
    around = cells[:, None] + steps
    shape = np.array(bins.number_at.shape)
    within = ((around >= 0) & (around < shape)).all(axis=2)
    around = np.clip(around, 0, shape - 1)
    number = bins.number_at[around[..., 0], around[..., 1], around[..., 2]]
    row = np.where(within, number - 1, -1)
    many = np.where(row >= 0, np.diff(bins.start)[row], 0)
    total = many.sum(axis=1)
    many, begin = many[row >= 0], bins.start[:-1][row[row >= 0]]
    before = np.cumsum(many) - many
    rows = np.repeat(begin - before, many) + np.arange(many.sum())
    return rows, np.cumsum(total) - total
