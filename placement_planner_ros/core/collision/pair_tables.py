"""Pairs of links with one or two revolute joints between them: where in those they are apart.

How such a pair lies depends on two angles at most, so their plane is divided into cells. Either the
links are certainly as far apart as stated throughout a cell, or the cell is open and says nothing.
One joint is taken for two of the same axis, of which the second does not turn.
Tables depend on the robot alone, are made with the first checker for it and shared by all.

Within a block of cells a point p that both joints carry moves, from the block's centre, by J δ up
to second order, so along the direction n that keeps the links apart at the centre

    n·p(q + δ) ≥ n·p(q) - |n·J_1 δ_1| - |n·J_2 δ_2| - (ρ_1 δ_1² + 2 ρ_2 |δ_1 δ_2| + ρ_2 δ_2²) / 2

with ρ_k the largest distance of any such p from joint k. No direction keeps apart links that reach
around each other: where their covers are not known to be apart, their meshes at the middle of a
block are, by as much more as any point can move within it, δ_2 ρ_2 + δ_1 (ρ_1 + δ_2 ρ_2).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.collision.against_mesh import mesh_meets_hull, meshes_meet
from placement_planner_ros.core.collision.meshes import MeshArrays, MeshTree, mesh_arrays
from placement_planner_ros.core.collision.separation import (
    BOUND_TOLERANCE_M,
    FREE,
    check_separation,
)
from placement_planner_ros.core.collision.shapes import Shape
from placement_planner_ros.core.disk_cache import code_digest, digest_of, stored_result
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array

Indices = npt.NDArray[np.int64]

CELLS_PER_TURN = 180
"""Cells in a whole turn."""
CELL_RAD = 2.0 * math.pi / CELLS_PER_TURN
_MAX_RANGE_CELLS = 64
"""Cells that one question looks at, at most; wider motions are left to the other checks."""
_FARTHEST_CELL = 1e6
"""Cells from the first one beyond which nothing is known."""
_BLOCK_CELLS = 16
"""Cells along the sides of the blocks that are looked at first; open ones are cut in four."""
_MESH_BLOCK_CELLS = 4
"""Cells along the sides of the largest blocks in which meshes are compared."""


class PairTables(NamedTuple):
    """Tables of t pairs for the kernels."""

    grid: Array
    """(t, 2) angles at which the two joints' first cells begin, rad."""
    counts: Indices
    """(t, 3) cells along the first joint, along the second, and the table's first in `cells`.

    A joint that can turn all the way round has `CELLS_PER_TURN`, the first after the last.
    """
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
    mesh: Indices
    """(s,) which of the meshes a part covers, -1 for a solid."""
    mesh_frames: Array
    """(g, 4, 4) of the meshes, in the frame of their vertices."""
    trees: MeshArrays


class _TableScratch(NamedTuple):
    """Work space: vertices (v, 3) where they are, axes (4, 3), and what `against_mesh` asks for."""

    points: Array
    axes: Array
    outer: Array
    """(4, 4) of the second joint."""
    work: Array
    between: Array
    """(4, 4) of one mesh in the frame of another."""
    local: Array
    stack: Indices


@dataclass(frozen=True, slots=True)
class TableShape:
    """A shape of a link: its convex sets, and its mesh where they cover one.

    Attributes:
        parts: vertices (m, 3) as bytes and the radius they are dilated by.
        mesh: its triangles.
        frame: (4, 4) as bytes, of the mesh.
    """

    parts: tuple[tuple[bytes, float], ...]
    mesh: MeshTree | None
    frame: bytes

    @classmethod
    def of(cls, shape: Shape, T: pin.SE3) -> TableShape:
        """Of a shape at T in the frame that `TablePair` says."""
        parts = tuple(
            ((s.vertices @ T.rotation.T + T.translation).tobytes(), float(s.radius))
            for s in shape.sets
        )
        return cls(parts, shape.mesh, T.homogeneous.tobytes())


@dataclass(frozen=True, slots=True)
class TablePair:
    """One pair, compared by content.

    Attributes:
        inner: in the frame of the joint that carries it, or of the world.
        outer: in the frame of the second joint.
        frames: (2, 4, 4) as bytes, as in `PairTables`.
        lower, upper: limits of the two joints, rad.
    """

    inner: tuple[TableShape, ...]
    outer: tuple[TableShape, ...]
    frames: bytes
    lower: tuple[float, ...]
    upper: tuple[float, ...]


def _cell_count(lower: float, upper: float) -> int:
    """How many a joint with these limits has."""
    return min(math.floor((upper - lower) / CELL_RAD) + 1, CELLS_PER_TURN)


@functools.lru_cache(maxsize=16)
def pair_tables(pairs: tuple[TablePair, ...], clear: float) -> PairTables:
    """Tables of these pairs; the same ones for the same pairs.

    Args:
        clear: metres that cells certify.
    """
    counts, tables, total = [], [np.zeros(0, dtype=np.bool_)], 0
    for number, pair in enumerate(pairs):
        step(f"tabling pair {number + 1} of {len(pairs)} of links up to two joints apart")
        # Where the table begins, and how many cells it has.
        first, second = map(_cell_count, pair.lower, pair.upper)
        counts.append((first, second, total))
        total += first * second
        make = functools.partial(_apart_bits, pair, first, second, clear)
        bits = stored_result("pair tables", _table_key(pair, clear), make)
        tables.append(np.unpackbits(bits, count=first * second).astype(np.bool_))
    return PairTables(
        grid=np.array([pair.lower for pair in pairs]).reshape(-1, 2),
        counts=np.array(counts, dtype=np.int64).reshape(-1, 3),
        clear=clear,
        apart=np.concatenate(tables),
    )


def _apart_bits(pair: TablePair, first: int, second: int, clear: float) -> npt.NDArray[np.uint8]:
    """Whether the pair is apart in each cell, a bit for each."""
    table = np.zeros((first, second), dtype=np.bool_)
    geometry = _pair_geometry(pair)
    _fill_table(geometry, _room_for(geometry), np.array(pair.lower), clear, table)
    return np.packbits(table)


def _table_key(pair: TablePair, clear: float) -> str:
    """Of all that a table depends on."""
    inner, outer = (
        tuple((shape.frame, shape.parts, shape.mesh and shape.mesh.digest) for shape in shapes)
        for shapes in (pair.inner, pair.outer)
    )
    joints = pair.frames, pair.lower, pair.upper
    return digest_of(code_digest(__name__), clear, joints, inner, outer)


def _pair_geometry(pair: TablePair) -> _Pair:
    shapes = pair.inner + pair.outer
    # All parts of both links, the inner one's first.
    parts = [part for shape in shapes for part in shape.parts]
    vertices = [np.frombuffer(data).reshape(-1, 3) for data, _ in parts]
    meshes = [shape for shape in shapes if shape.mesh is not None]
    number = {id(shape): i for i, shape in enumerate(meshes)}
    return _Pair(
        frames=np.frombuffer(pair.frames).reshape(2, 4, 4).copy(),
        inner=sum(len(shape.parts) for shape in pair.inner),
        parts=np.cumsum([0] + [len(v) for v in vertices]),
        radius=np.array([radius for _, radius in parts]),
        vertices=np.vstack(vertices),
        mesh=np.array(
            [number.get(id(shape), -1) for shape in shapes for _ in shape.parts], dtype=np.int64
        ),
        mesh_frames=np.array(
            [np.frombuffer(shape.frame).reshape(4, 4) for shape in meshes]
        ).reshape(-1, 4, 4),
        trees=mesh_arrays([shape.mesh for shape in meshes if shape.mesh is not None]),
    )


def _room_for(pair: _Pair) -> _TableScratch:
    most = int(np.diff(pair.parts).max(initial=0))
    return _TableScratch(
        points=pair.vertices.copy(),
        axes=np.zeros((4, 3)),
        outer=np.eye(4),
        work=np.zeros((6, 4)),
        between=np.eye(4),
        local=np.zeros((most + 12, 3)),
        stack=np.zeros((256, 2), dtype=np.int64),
    )


@kernel(lean=True)
def apart_within(
    tables: PairTables, table: int, q1: float, q2: float, delta1: float, delta2: float
) -> bool:
    """Whether a pair is certainly `clear` apart wherever its joints are within ±delta of q.

    It is where all cells say so that these ranges touch.
    """
    # Joint values and ranges in cells of the table.
    grid, counts = tables.grid, tables.counts
    u = (q1 - grid[table, 0]) / CELL_RAD
    v = (q2 - grid[table, 1]) / CELL_RAD
    du = delta1 / CELL_RAD
    dv = delta2 / CELL_RAD
    if counts[table, 1] == 1:
        # One cell for all of it.
        v, dv = 0.5, 0.0
    # Too wide a range, or too far away, for whole numbers.
    if not (
        du <= _MAX_RANGE_CELLS
        and dv <= _MAX_RANGE_CELLS
        and abs(u) < _FARTHEST_CELL
        and abs(v) < _FARTHEST_CELL
    ):
        return False
    # A joint that does not go round must stay within its rows or columns.
    rows, columns = counts[table, 0], counts[table, 1]
    if not ((rows == CELLS_PER_TURN or u >= du) and (columns == CELLS_PER_TURN or v >= dv)):
        return False
    if not (
        (rows == CELLS_PER_TURN or u + du < rows)
        and (columns == CELLS_PER_TURN or v + dv < columns)
    ):
        return False
    # All cells that the range touches, if they are not too many.
    i0, i1 = int(np.floor(u - du)), int(np.floor(u + du))
    j0, j1 = int(np.floor(v - dv)), int(np.floor(v + dv))
    if (i1 - i0 + 1) * (j1 - j0 + 1) > _MAX_RANGE_CELLS:
        return False
    # Every one of them must say that the pair is apart; round joints wrap.
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            if not tables.apart[counts[table, 2] + (i % rows) * columns + j % columns]:
                return False
    return True


@kernel()
def _fill_table(
    pair: _Pair, room: _TableScratch, lower: Array, clear: float, apart: npt.NDArray[np.bool_]
) -> None:
    """All cells (m, n) of one table: a block at a time, and where that is open its quarters."""
    # Directions that last kept parts apart, and blocks that are still to be looked at.
    rows, columns = apart.shape
    s = len(pair.radius)
    known = np.zeros((pair.inner, s - pair.inner, 3))
    stack = np.empty((64, 3), dtype=np.int64)
    for i in range(0, rows, _BLOCK_CELLS):
        for j in range(0, columns, _BLOCK_CELLS):
            stack[0, 0], stack[0, 1], stack[0, 2] = i, j, _BLOCK_CELLS
            waiting = 1
            while waiting > 0:
                waiting -= 1
                k, m, size = stack[waiting]
                # A block beyond the last row or column is no larger than the table.
                across, along = min(size, rows - k), min(size, columns - m)
                # The block's middle, and half of what it spans, with some room for rounding.
                delta1, delta2 = 0.5 * across * CELL_RAD + 1e-9, 0.5 * along * CELL_RAD + 1e-9
                q1, q2 = lower[0] + k * CELL_RAD + delta1, lower[1] + m * CELL_RAD + delta2
                # The outer link at the middle, against all that may happen within the block.
                _place_outer(pair, room, q1, q2)
                if _apart_around(
                    pair, room, known, delta1, delta2, clear, size <= _MESH_BLOCK_CELLS
                ):
                    apart[k : k + size, m : m + size] = True
                elif size > 1:
                    # The block's quarters, those that begin within the table.
                    half = size // 2
                    for corner in range(4):
                        k2, m2 = k + half * (corner % 2), m + half * (corner // 2)
                        if k2 < rows and m2 < columns:
                            stack[waiting, 0], stack[waiting, 1], stack[waiting, 2] = k2, m2, half
                            waiting += 1


@kernel()
def _apart_around(
    pair: _Pair,
    room: _TableScratch,
    known: Array,
    delta1: float,
    delta2: float,
    clear: float,
    meshes: bool,
) -> bool:
    """Whether a pair keeps `clear` wherever its joints are within ±delta of where it is placed.

    Args:
        known: (., ., 3) direction that last kept two parts apart, tried before a new one is sought.
        meshes: whether what covers leave open is asked of the meshes.
    """
    parts, radius = pair.parts, pair.radius
    points, work = room.points, room.work
    B = pair.frames[1]
    # The offset between both joints' origins.
    offset = np.sqrt(B[0, 3] ** 2 + B[1, 3] ** 2 + B[2, 3] ** 2)
    mesh = other = -1
    # How far any point moves, for the meshes.
    moved = _motion_bound(pair, room, delta1, delta2)
    for o in range(pair.inner, len(radius)):
        # What the formula's second order may take: ρ_2 is at most the distance `far` from the
        # second joint's origin, ρ_1 at most that and the offset between both joints.
        far = 0.0
        for v in range(parts[o], parts[o + 1]):
            x, y, z = pair.vertices[v, 0], pair.vertices[v, 1], pair.vertices[v, 2]
            far = max(far, x * x + y * y + z * z)
        far = np.sqrt(far)
        bend = 0.5 * (delta1 * delta1 * (offset + far) + delta2 * (2.0 * delta1 + delta2) * far)
        # Against each part of the inner link: the distance that is to be kept to first order.
        for s in range(pair.inner):
            need = clear + BOUND_TOLERANCE_M + radius[o] + radius[s] + bend
            apart = False
            for attempt in range(2):
                # Along the remembered direction first, then along that of the distance.
                if attempt == 0:
                    work[5, :3] = known[s, o - pair.inner]
                else:
                    work[5, :3] = points[parts[o]] - points[parts[s]]
                    check_separation(
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
                # How far they stay apart along it while the joints move.
                if length > 1e-9:
                    nx, ny, nz = nx / length, ny / length, nz / length
                    gap = _gap_along(pair, room, o, s, delta1, delta2, (nx, ny, nz))
                    apart = gap >= need
                if apart:
                    # Remember it.
                    known[s, o - pair.inner, 0] = nx
                    known[s, o - pair.inner, 1] = ny
                    known[s, o - pair.inner, 2] = nz
                    break
            if apart:
                continue
            # The covers leave it open: ask the meshes, where there are any and it is time.
            a, b = pair.mesh[s], pair.mesh[o]
            if not meshes or (a < 0 and b < 0):
                return False
            # This pair of meshes has been asked.
            if a >= 0 and b >= 0 and a == mesh and b == other:
                continue
            if not _meshes_apart(pair, room, s, o, clear + moved):
                return False
            mesh, other = a, b
    return True


@kernel()
def _motion_bound(pair: _Pair, room: _TableScratch, delta1: float, delta2: float) -> float:
    """How far any point of the outer link moves within ±delta, at most (the module's last)."""
    # The vertices of the outer link, moved by the second joint, then by both.
    most = 0.0
    for v in range(pair.parts[pair.inner], len(room.points)):
        inner = delta2 * _from_axis(room, 1, v)
        most = max(most, inner + delta1 * (_from_axis(room, 0, v) + inner))
    # The same for what the parts' radii add.
    thick = 0.0
    for part in range(len(pair.radius)):
        thick = max(thick, pair.radius[part])
    return most + delta2 * thick + delta1 * thick * (1.0 + delta2)


@kernel(inline=True)
def _from_axis(room: _TableScratch, joint: int, v: int) -> float:
    """ρ of a placed vertex: its distance from the axis of the first or second joint."""
    # The distance of the vertex from the axis at its closest.
    axis, at = room.axes[2 * joint], room.axes[2 * joint + 1]
    x, y, z = room.points[v, 0] - at[0], room.points[v, 1] - at[1], room.points[v, 2] - at[2]
    along = x * axis[0] + y * axis[1] + z * axis[2]
    return float(np.sqrt(max(x * x + y * y + z * z - along * along, 0.0)))


@kernel()
def _meshes_apart(pair: _Pair, room: _TableScratch, s: int, o: int, need: float) -> bool:
    """Whether what parts s and o belong to, one a mesh at least, keep `need` where they are."""
    # Two meshes: the pose of the one in the frame of the other.
    a, b = pair.mesh[s], pair.mesh[o]
    if a >= 0 and b >= 0:
        _relative_pose(pair.mesh_frames[a], room.outer, pair.mesh_frames[b], room.between)
        answer = meshes_meet(
            pair.trees, a, b, room.between, need, need, room.stack, room.local, room.work
        )
        return answer == FREE
    # A mesh against the convex part of the other link.
    mesh, part = (a, o) if a >= 0 else (b, s)
    # The mesh where it is, and the points of the other in its frame.
    T = room.between
    if a >= 0:
        T[:] = pair.mesh_frames[a]
    else:
        T[:] = room.outer @ pair.mesh_frames[b]
    # The part's vertices in the mesh's frame.
    first, last = pair.parts[part], pair.parts[part + 1]
    for v in range(first, last):
        for i in range(3):
            room.local[v - first, i] = 0.0
            for j in range(3):
                room.local[v - first, i] += T[j, i] * (room.points[v, j] - T[j, 3])
    need += pair.radius[part]
    # The mesh against their hull, the radius added.
    answer = mesh_meets_hull(pair.trees, mesh, room.local, last - first, need, need, room.work)
    return answer == FREE


@kernel()
def _relative_pose(A: Array, T: Array, B: Array, out: Array) -> None:
    """Set `out` to A⁻¹ T B, all (4, 4) poses."""
    # T B, seen from A: rotation transposed, its origin taken off.
    C = T @ B
    for i in range(3):
        for j in range(4):
            out[i, j] = 0.0
            for k in range(3):
                out[i, j] += A[k, i] * (C[k, j] - (A[k, 3] if j == 3 else 0.0))


@kernel()
def _place_outer(pair: _Pair, room: _TableScratch, q1: float, q2: float) -> None:
    """Put the outer link where it is at q; `axes` are direction and origin of both joints."""
    B = pair.frames[1]
    axes, points, N = room.axes, room.points, room.outer
    # The first joint's frame, turned by q1.
    T = pair.frames[0].copy()
    _turn_about_z(T, q1)
    # The second joint's frame in it, before it turns; directions and origins of both axes.
    for i in range(3):
        for j in range(4):
            N[i, j] = T[i, 0] * B[0, j] + T[i, 1] * B[1, j] + T[i, 2] * B[2, j]
        N[i, 3] += T[i, 3]
        axes[0, i], axes[1, i] = T[i, 2], T[i, 3]
        axes[2, i], axes[3, i] = N[i, 2], N[i, 3]
    # Turned by q2, with the vertices of the outer link.
    _turn_about_z(N, q2)
    for v in range(pair.parts[pair.inner], len(points)):
        x, y, z = pair.vertices[v, 0], pair.vertices[v, 1], pair.vertices[v, 2]
        for c in range(3):
            points[v, c] = N[c, 3] + N[c, 0] * x + N[c, 1] * y + N[c, 2] * z


@kernel(inline=True)
def _gap_along(
    pair: _Pair,
    room: _TableScratch,
    o: int,
    s: int,
    delta1: float,
    delta2: float,
    n: tuple[float, float, float],
) -> float:
    """How far outer part o stays beyond inner part s along n, up to first order (the formula's).

    n·J_k = n·(axis × (p - at)) = (n × axis)·(p - at)
    """
    points, axes = room.points, room.axes
    nx, ny, nz = n
    # n × axis of both joints, and its product with their origins.
    ax, ay, az = _cross_product(nx, ny, nz, axes[0])
    bx, by, bz = _cross_product(nx, ny, nz, axes[2])
    a0 = ax * axes[1, 0] + ay * axes[1, 1] + az * axes[1, 2]
    b0 = bx * axes[3, 0] + by * axes[3, 1] + bz * axes[3, 2]
    # The outer part's vertex that can come nearest along n, while both joints move.
    nearest = np.inf
    for v in range(pair.parts[o], pair.parts[o + 1]):
        x, y, z = points[v, 0], points[v, 1], points[v, 2]
        slip = delta1 * abs(ax * x + ay * y + az * z - a0)
        slip += delta2 * abs(bx * x + by * y + bz * z - b0)
        nearest = min(nearest, nx * x + ny * y + nz * z - slip)
    # The inner part's vertex that reaches furthest along n.
    reach = -np.inf
    for v in range(pair.parts[s], pair.parts[s + 1]):
        reach = max(reach, nx * points[v, 0] + ny * points[v, 1] + nz * points[v, 2])
    return nearest - reach


@kernel(inline=True)
def _turn_about_z(T: Array, angle: float) -> None:
    """T (4, 4) turned about its z."""
    c, s = math.cos(angle), math.sin(angle)
    for k in range(3):
        x, y = T[k, 0], T[k, 1]
        T[k, 0] = c * x + s * y
        T[k, 1] = c * y - s * x


@kernel(inline=True)
def _cross_product(x: float, y: float, z: float, axis: Array) -> tuple[float, float, float]:
    """(x, y, z) × axis."""
    return y * axis[2] - z * axis[1], z * axis[0] - x * axis[2], x * axis[1] - y * axis[0]
