"""Pairs of links with two revolute joints between them: where in those joints they are apart.

How such a pair lies depends on two angles alone, so their plane is divided into cells. Either the
links are certainly as far apart as stated throughout a cell, or the cell is open and says nothing.
Tables depend on the robot alone, are made with the first checker for it and shared by all.

Within a block of cells a point p that both joints carry moves, from the block's centre, by J δ up
to second order, so along the direction n that keeps the links apart at the centre

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

from placement_planner_ros.core.collision.separation import TOLERANCE, separate
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array

Indices = npt.NDArray[np.int64]

CELL = math.radians(2.0)
_MAX_CELLS = 1 << 18
"""Joints that turn further than this many cells are left without a table."""
_MAX_RANGE = 64
"""Cells that one question looks at, at most; wider motions are left to the other checks."""
_BLOCK = 16
"""Cells along the sides of the blocks that are looked at first; open ones are cut in four."""


class PairTables(NamedTuple):
    """Tables of t pairs for the kernels."""

    grid: Array
    """(t, 2) lower limits of the two joints, rad."""
    counts: Indices
    """(t, 3) cells along the first joint, along the second, and the table's first in `cells`."""
    clear: float
    """Metres by which pairs are apart throughout a cell that says so."""
    apart: npt.NDArray[np.bool_]
    """(.,) whether a cell says that a pair is apart."""


class _Pair(NamedTuple):
    """What the cells of one pair are made from."""

    frames: Array
    """(2, 4, 4) pose of the first joint in the frame the inner link is given in, and of the second
    in that of the first, both at angle zero."""
    inner: int
    """How many of the parts are the inner link's; the first."""
    parts: Indices
    """(s + 1,) first vertex of each part."""
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
    """Tables of these pairs; the same ones for the same pairs.

    Args:
        clear: metres that cells certify.
    """
    counts, tables, total = [], [np.zeros(0, dtype=np.bool_)], 0
    for number, pair in enumerate(pairs):
        step(f"tabling pair {number + 1} of {len(pairs)} of links two joints apart")
        first, second = (
            math.floor((high - low) / CELL) + 1
            for low, high in zip(pair.lower, pair.upper, strict=True)
        )
        counts.append((first, second, total))
        total += first * second
        table = np.zeros((first, second), dtype=np.bool_)
        _fill(_geometry(pair), np.array(pair.lower), clear, table)
        tables.append(table.ravel())
    return PairTables(
        grid=np.array([pair.lower for pair in pairs]).reshape(-1, 2),
        counts=np.array(counts, dtype=np.int64).reshape(-1, 3),
        clear=clear,
        apart=np.concatenate(tables),
    )


def _geometry(pair: TablePair) -> _Pair:
    parts = pair.inner.parts + pair.outer.parts
    vertices = [np.frombuffer(data).reshape(-1, 3) for data, _ in parts]
    return _Pair(
        frames=np.frombuffer(pair.frames).reshape(2, 4, 4).copy(),
        inner=len(pair.inner.parts),
        parts=np.cumsum([0] + [len(v) for v in vertices]),
        radius=np.array([radius for _, radius in parts]),
        vertices=np.vstack(vertices),
    )


@kernel(lean=True)
def apart_within(
    tables: PairTables, table: int, q1: float, q2: float, delta1: float, delta2: float
) -> bool:
    """Whether a pair is certainly `clear` apart wherever its joints are within ±delta of q.

    It is where all cells say so that these ranges touch.
    """
    grid, counts = tables.grid, tables.counts
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
            if not tables.apart[counts[table, 2] + i * counts[table, 1] + j]:
                return False
    return True


@kernel()
def _fill(pair: _Pair, lower: Array, clear: float, apart: npt.NDArray[np.bool_]) -> None:
    """All cells (m, n) of one table: a block at a time, and where that is open its quarters."""
    rows, columns = apart.shape
    points = pair.vertices.copy()
    s = len(pair.radius)
    known = np.zeros((pair.inner, s - pair.inner, 3))
    stack = np.empty((64, 3), dtype=np.int64)
    for i in range(0, rows, _BLOCK):
        for j in range(0, columns, _BLOCK):
            stack[0, 0], stack[0, 1], stack[0, 2] = i, j, _BLOCK
            waiting = 1
            while waiting > 0:
                waiting -= 1
                k, m, size = stack[waiting]
                q1 = lower[0] + (k + 0.5 * size) * CELL
                q2 = lower[1] + (m + 0.5 * size) * CELL
                if _apart_around(pair, points, known, q1, q2, 0.5 * size * CELL + 1e-9, clear):
                    apart[k : k + size, m : m + size] = True
                elif size > 1:
                    half = size // 2
                    for corner in range(4):
                        k2, m2 = k + half * (corner % 2), m + half * (corner // 2)
                        if k2 < rows and m2 < columns:
                            stack[waiting, 0], stack[waiting, 1], stack[waiting, 2] = k2, m2, half
                            waiting += 1


@kernel()
def _apart_around(
    pair: _Pair, points: Array, known: Array, q1: float, q2: float, delta: float, clear: float
) -> bool:
    """Whether a pair keeps `clear` wherever its joints are within ±delta of q (module's formula).

    Args:
        points: (v, 3) vertices, of which the outer link's are put where they are at q.
        known: (., ., 3) direction that last kept two parts apart, tried before a new one is sought.
    """
    parts, radius = pair.parts, pair.radius
    B = pair.frames[1]
    axes = np.empty((4, 3))
    work = np.zeros((6, 4))
    _place_outer(pair, points, axes, q1, q2)
    offset = np.sqrt(B[0, 3] ** 2 + B[1, 3] ** 2 + B[2, 3] ** 2)
    for o in range(pair.inner, len(radius)):
        # What the formula's second order may take: ρ_2 is at most the distance `far` from the
        # second joint's origin, ρ_1 at most that and the offset between both joints.
        far = 0.0
        for v in range(parts[o], parts[o + 1]):
            x, y, z = pair.vertices[v, 0], pair.vertices[v, 1], pair.vertices[v, 2]
            far = max(far, x * x + y * y + z * z)
        bend = 0.5 * delta * delta * (offset + 4.0 * np.sqrt(far))
        for s in range(pair.inner):
            need = clear + TOLERANCE + radius[o] + radius[s] + bend
            apart = False
            for attempt in range(2):
                if attempt == 0:
                    work[5, :3] = known[s, o - pair.inner]
                else:
                    work[5, :3] = points[parts[o]] - points[parts[s]]
                    separate(
                        points,
                        parts[o],
                        parts[o + 1],
                        points,
                        parts[s],
                        parts[s + 1],
                        np.inf,
                        0.0,
                        work,
                    )
                nx, ny, nz = work[5, 0], work[5, 1], work[5, 2]
                length = np.sqrt(nx * nx + ny * ny + nz * nz)
                if length > 1e-9:
                    nx, ny, nz = nx / length, ny / length, nz / length
                    apart = _gap_along(pair, points, axes, o, s, delta, nx, ny, nz) >= need
                if apart:
                    known[s, o - pair.inner, 0] = nx
                    known[s, o - pair.inner, 1] = ny
                    known[s, o - pair.inner, 2] = nz
                    break
            if not apart:
                return False
    return True


@kernel()
def _place_outer(pair: _Pair, points: Array, axes: Array, q1: float, q2: float) -> None:
    """Put the outer link where it is at q; `axes` (4, 3): direction and origin of both joints."""
    B = pair.frames[1]
    T = pair.frames[0].copy()
    _turn(T, q1)
    N = T.copy()
    for i in range(3):
        for j in range(4):
            N[i, j] = T[i, 0] * B[0, j] + T[i, 1] * B[1, j] + T[i, 2] * B[2, j] + T[i, 3] * B[3, j]
        axes[0, i], axes[1, i] = T[i, 2], T[i, 3]
        axes[2, i], axes[3, i] = N[i, 2], N[i, 3]
    _turn(N, q2)
    for v in range(pair.parts[pair.inner], len(points)):
        x, y, z = pair.vertices[v, 0], pair.vertices[v, 1], pair.vertices[v, 2]
        for c in range(3):
            points[v, c] = N[c, 3] + N[c, 0] * x + N[c, 1] * y + N[c, 2] * z


@kernel(inline=True)
def _gap_along(
    pair: _Pair,
    points: Array,
    axes: Array,
    o: int,
    s: int,
    delta: float,
    nx: float,
    ny: float,
    nz: float,
) -> float:
    """How far outer part o stays beyond inner part s along n, up to first order (the formula's).

    n·J_k = n·(axis × (p - at)) = (n × axis)·(p - at)
    """
    ax, ay, az = _cross(nx, ny, nz, axes[0])
    bx, by, bz = _cross(nx, ny, nz, axes[2])
    a0 = ax * axes[1, 0] + ay * axes[1, 1] + az * axes[1, 2]
    b0 = bx * axes[3, 0] + by * axes[3, 1] + bz * axes[3, 2]
    nearest = np.inf
    for v in range(pair.parts[o], pair.parts[o + 1]):
        x, y, z = points[v, 0], points[v, 1], points[v, 2]
        slip = abs(ax * x + ay * y + az * z - a0) + abs(bx * x + by * y + bz * z - b0)
        nearest = min(nearest, nx * x + ny * y + nz * z - delta * slip)
    reach = -np.inf
    for v in range(pair.parts[s], pair.parts[s + 1]):
        reach = max(reach, nx * points[v, 0] + ny * points[v, 1] + nz * points[v, 2])
    return nearest - reach


@kernel(inline=True)
def _turn(T: Array, angle: float) -> None:
    """T (4, 4) turned about its z."""
    c, s = math.cos(angle), math.sin(angle)
    for k in range(3):
        x, y = T[k, 0], T[k, 1]
        T[k, 0] = c * x + s * y
        T[k, 1] = c * y - s * x


@kernel(inline=True)
def _cross(x: float, y: float, z: float, axis: Array) -> tuple[float, float, float]:
    """(x, y, z) × axis."""
    return y * axis[2] - z * axis[1], z * axis[0] - x * axis[2], x * axis[1] - y * axis[0]
