"""Pairs of links with two revolute joints between them: where in those joints they are apart.

How such a pair lies depends on two angles alone, so their plane is divided into cells, and each is
settled the first time it is asked for: either the links are certainly as far apart as stated
throughout the cell, or the cell is open and says nothing. Cells depend on the robot alone and are
shared by all that is made for it.

Within a cell a point p that both joints carry moves, from the cell's centre, by J δ up to second
order, so along the direction n that keeps the links apart at the centre

    n·p(q + δ) ≥ n·p(q) - |n·J_1 δ_1| - |n·J_2 δ_2| - (ρ_1 δ_1² + 2 ρ_2 |δ_1 δ_2| + ρ_2 δ_2²) / 2

with ρ_k the largest distance of any such p from joint k.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.robot.separation import TOLERANCE, separate_hulls
from placement_planner_ros.core.types import Array

Indices = npt.NDArray[np.int64]

CELL = math.radians(2.0)
_MAX_CELLS = 1 << 18
"""Joints that turn further than this many cells are left without a table."""
_MAX_RANGE = 64
"""Cells that one question looks at, at most; wider motions are left to the other checks."""
_UNKNOWN, _APART, _OPEN = 0, 1, 2


class PairTables(NamedTuple):
    """Tables of t pairs for the kernels; cells are filled as they are asked for."""

    grid: Array
    """(t, 2) lower limits of the two joints, rad."""
    counts: Indices
    """(t, 3) cells along the first joint, along the second, and the table's first in `cells`."""
    clear: float
    """Metres by which pairs are apart throughout a cell that says so."""
    cells: npt.NDArray[np.int8]
    """(.,) unknown, apart or open."""
    frames: Array
    """(t, 2, 4, 4) pose of the first joint in the frame the inner link is given in, and of the
    second in that of the first, both at angle zero."""
    parts: Indices
    """(t, 2, 2) inner and outer link: range of `sets`."""
    sets: Indices
    """(s + 1,) first vertex of each solid part."""
    radius: Array
    """(s,) that it is dilated by."""
    vertices: Array
    """(v, 3) inner links in their own frame, outer ones in that of the second joint."""


@dataclass(frozen=True, slots=True)
class TableLink:
    """The solid parts of a link: vertices (m, 3) as bytes and the radius they are dilated by."""

    parts: tuple[tuple[bytes, float], ...]

    @classmethod
    def of(cls, parts: list[tuple[Array, float]]) -> TableLink:
        """From vertices (m, 3), metres, in the frame that `TablePair` says."""
        return cls(tuple((np.ascontiguousarray(v).tobytes(), float(r)) for v, r in parts))


@dataclass(frozen=True, slots=True)
class TablePair:
    """One pair, compared by content.

    Attributes:
        inner: in the frame of the joint that carries it, or of the world.
        outer: in the frame of the second joint.
        frames: (2, 4, 4) as bytes, as in `PairTables`.
        lower, upper: limits of the two joints, rad.
    """

    inner: TableLink
    outer: TableLink
    frames: bytes
    lower: tuple[float, ...]
    upper: tuple[float, ...]


def can_be_tabled(lower: Array, upper: Array) -> bool:
    """Whether two joints (2,) are limited enough for a table."""
    counts = np.ceil((upper - lower) / CELL)
    return bool(np.isfinite(counts).all() and np.prod(counts + 1) <= _MAX_CELLS)


@lru_cache(maxsize=16)
def pair_tables(pairs: tuple[TablePair, ...], clear: float) -> PairTables:
    """Tables of these pairs, all cells unknown yet; the same ones for the same pairs."""
    sets, radius, parts, counts = [0], list[float](), [], []
    vertices = [np.zeros((0, 3))]
    cells = 0
    for pair in pairs:
        ranges = []
        for link in (pair.inner, pair.outer):
            first = len(radius)
            for data, dilated in link.parts:
                vertices.append(np.frombuffer(data).reshape(-1, 3))
                sets.append(sets[-1] + len(vertices[-1]))
                radius.append(dilated)
            ranges.append((first, len(radius)))
        parts.append(ranges)
        along = [
            math.floor((high - low) / CELL) + 1
            for low, high in zip(pair.lower, pair.upper, strict=True)
        ]
        counts.append((*along, cells))
        cells += along[0] * along[1]
    frames = [np.frombuffer(pair.frames).reshape(2, 4, 4) for pair in pairs]
    return PairTables(
        grid=np.array([pair.lower for pair in pairs]).reshape(-1, 2),
        counts=np.array(counts, dtype=np.int64).reshape(-1, 3),
        clear=clear,
        cells=np.zeros(cells, dtype=np.int8),
        frames=np.array(frames).reshape(-1, 2, 4, 4),
        parts=np.array(parts, dtype=np.int64).reshape(-1, 2, 2),
        sets=np.array(sets, dtype=np.int64),
        radius=np.array(radius),
        vertices=np.ascontiguousarray(np.vstack(vertices)),
    )


@njit(cache=True)
def apart_within(
    tables: PairTables, table: int, q1: float, q2: float, delta1: float, delta2: float
) -> bool:
    """Whether a pair is certainly `clear` apart wherever its joints are within ±delta of q."""
    grid, counts, cells = tables.grid, tables.counts, tables.cells
    u = (q1 - grid[table, 0]) / CELL
    v = (q2 - grid[table, 1]) / CELL
    du = delta1 / CELL
    dv = delta2 / CELL
    if not (u >= du and v >= dv and u + du < counts[table, 0] and v + dv < counts[table, 1]):
        return False
    i0, i1 = int(u - du), int(u + du)
    j0, j1 = int(v - dv), int(v + dv)
    if (i1 - i0 + 1) * (j1 - j0 + 1) > _MAX_RANGE:
        return False
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            cell = counts[table, 2] + i * counts[table, 1] + j
            if cells[cell] == _UNKNOWN:
                cells[cell] = _APART if _is_apart(tables, table, i, j) else _OPEN
            if cells[cell] == _OPEN:
                return False
    return True


@njit(cache=True)
def _is_apart(tables: PairTables, table: int, i: int, j: int) -> bool:
    """Whether the pair keeps `clear` throughout one cell (this module's formula)."""
    grid, parts, sets = tables.grid, tables.parts, tables.sets
    A, B = tables.frames[table, 0], tables.frames[table, 1]
    q1 = grid[table, 0] + (i + 0.5) * CELL
    q2 = grid[table, 1] + (j + 0.5) * CELL
    delta = 0.5 * CELL + 1e-9
    M = A.copy()
    _turn(M, q1)
    N = M @ B
    axis1, at1 = M[:3, 2].copy(), M[:3, 3].copy()
    axis2, at2 = N[:3, 2].copy(), N[:3, 3].copy()
    _turn(N, q2)
    offset = np.sqrt(B[0, 3] ** 2 + B[1, 3] ** 2 + B[2, 3] ** 2)
    work = np.zeros((6, 4))
    for o in range(parts[table, 1, 0], parts[table, 1, 1]):
        outer = tables.vertices[sets[o] : sets[o + 1]]
        m = outer.shape[0]
        far = 0.0
        for k in range(m):
            far = max(far, outer[k, 0] ** 2 + outer[k, 1] ** 2 + outer[k, 2] ** 2)
        far = np.sqrt(far)
        bend = 0.5 * delta * delta * (offset + 4.0 * far)
        for s in range(parts[table, 0, 0], parts[table, 0, 1]):
            inner = tables.vertices[sets[s] : sets[s + 1]]
            need = tables.clear + TOLERANCE + tables.radius[o] + tables.radius[s] + bend
            points = np.empty((m + inner.shape[0], 3))
            points[m:] = inner
            middle = np.zeros(3)
            for k in range(m):
                for c in range(3):
                    points[k, c] = (
                        N[c, 3]
                        + N[c, 0] * outer[k, 0]
                        + N[c, 1] * outer[k, 1]
                        + N[c, 2] * outer[k, 2]
                    )
                    middle[c] += points[k, c] / m
            for k in range(inner.shape[0]):
                for c in range(3):
                    middle[c] -= inner[k, c] / inner.shape[0]
            work[5, :3] = middle
            separate_hulls(points, 0, m, m, len(points), np.inf, 0.0, work)
            nx, ny, nz = work[5, 0], work[5, 1], work[5, 2]
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            if not length > 1e-9:
                return False
            nx, ny, nz = nx / length, ny / length, nz / length
            # n·J_k = n·(axis × (p - at)) = (n × axis)·(p - at)
            ax, ay, az = _cross(nx, ny, nz, axis1)
            bx, by, bz = _cross(nx, ny, nz, axis2)
            a0 = ax * at1[0] + ay * at1[1] + az * at1[2]
            b0 = bx * at2[0] + by * at2[1] + bz * at2[2]
            nearest = np.inf
            for k in range(m):
                x, y, z = points[k, 0], points[k, 1], points[k, 2]
                slip = abs(ax * x + ay * y + az * z - a0) + abs(bx * x + by * y + bz * z - b0)
                nearest = min(nearest, nx * x + ny * y + nz * z - delta * slip)
            reach = -np.inf
            for k in range(m, len(points)):
                reach = max(reach, nx * points[k, 0] + ny * points[k, 1] + nz * points[k, 2])
            if not nearest - reach >= need:
                return False
    return True


@njit(cache=True, inline="always")
def _turn(T: Array, angle: float) -> None:
    """T (4, 4) turned about its z."""
    c, s = math.cos(angle), math.sin(angle)
    for k in range(3):
        x, y = T[k, 0], T[k, 1]
        T[k, 0] = c * x + s * y
        T[k, 1] = c * y - s * x


@njit(cache=True, inline="always")
def _cross(x: float, y: float, z: float, axis: Array) -> tuple[float, float, float]:
    return y * axis[2] - z * axis[1], z * axis[0] - x * axis[2], x * axis[1] - y * axis[0]
