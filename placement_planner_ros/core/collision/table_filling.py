"""Tables of pairs made: blocks of cells, in whose middle a pair keeps more than it moves within."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_robot import bodies_meet, spheres_apart
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch, FlatArm, scratch_for
from placement_planner_ros.core.collision.edges import bound_motion
from placement_planner_ros.core.collision.pair_tables import CELL_RAD, PairTables, cell_count
from placement_planner_ros.core.collision.placing import place_all_spheres, place_joints
from placement_planner_ros.core.collision.separation import FREE
from placement_planner_ros.core.disk_cache import code_digest, digest_of, recalled_result
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array

_BLOCK_CELLS = 16
"""Cells along the sides of the blocks that are looked at first; open ones are cut in four."""
_ROUNDING_RAD = 1e-9
"""rad by which blocks overlap."""


def with_pair_tables(flat: FlatArm, chain: Chain, clear: float) -> FlatArm:
    """The same arm with a table for each pair of rigid links up to two turning joints apart.

    Args:
        clear: what tables certify, metres.
    """
    pairs, scratch = flat.arrays.pairs.copy(), scratch_for(flat, 0)
    lower: list[list[float]] = []
    shapes: list[tuple[int, ...]] = []
    tables: list[bytes] = []
    for row, (a, b, *_) in enumerate(pairs.tolist()):
        # The joints between both, which have limits and turn.
        inner, outer = flat.bodies[a], flat.bodies[b]
        joints = np.arange(inner.joint + 1, outer.joint + 1)
        limits = np.column_stack([chain.lower[joints], chain.upper[joints]])
        if (
            len(joints) > 2
            or not (inner.rigid and outer.rigid and np.isfinite(limits).all())
            or chain.prismatic[joints].any()
        ):
            continue
        step(f"tabling links {inner.name} and {outer.name}")
        shape = (*(cell_count(*limit) for limit in limits.tolist()), 1)[:2]
        key = digest_of(
            code_digest(__name__), clear, limits, chain.fixed[joints], *map(flat.digest, (a, b))
        )
        make = partial(_apart_bits, flat.arrays, scratch, row, limits, shape, clear)
        # One more table behind the others.
        pairs[row, at.PAIR_TABLE] = len(tables)
        lower.append([*limits[:, 0], 0.0][:2])
        shapes.append(shape)
        tables.append(recalled_result("pair tables", key, make))
    sizes = np.array(shapes, dtype=np.int64).reshape(-1, 2)
    ends = np.cumsum((sizes + 1).prod(axis=1))
    made = PairTables(
        np.array(lower).reshape(-1, 2),
        np.column_stack([sizes, ends - (sizes + 1).prod(axis=1)]),
        clear,
        _open_counts(tuple(tables), tuple(shapes)),
    )
    return replace(flat, arrays=flat.arrays._replace(pairs=pairs, tables=made))


@lru_cache(maxsize=8)
def _open_counts(
    tables: tuple[bytes, ...], shapes: tuple[tuple[int, ...], ...]
) -> npt.NDArray[np.int32]:
    """`PairTables.open` of bits; an arm has the same with whatever it holds."""
    counts = [np.zeros(0, dtype=np.int32)]
    for bits, shape in zip(tables, shapes, strict=True):
        apart = np.unpackbits(np.frombuffer(bits, np.uint8), count=shape[0] * shape[1])
        opened = np.zeros((shape[0] + 1, shape[1] + 1), dtype=np.int32)
        np.cumsum(1 - apart.reshape(shape), axis=0, dtype=np.int32, out=opened[1:, 1:])
        np.cumsum(opened[1:, 1:], axis=1, dtype=np.int32, out=opened[1:, 1:])
        counts.append(opened.ravel())
    return np.concatenate(counts)


def _apart_bits(
    arm: ArmArrays,
    scratch: ArmScratch,
    pair: int,
    limits: Array,
    shape: tuple[int, ...],
    clear: float,
) -> bytes:
    """Whether the pair is apart in each cell, a bit for each."""
    table = np.zeros(shape, dtype=np.bool_)
    _fill_table(arm, scratch, pair, np.append(limits[:, 0], 0.0), clear, table)
    return np.packbits(table).tobytes()


@njit(cache=True, nogil=True)
def _fill_table(
    arm: ArmArrays,
    scratch: ArmScratch,
    pair: int,
    lower: Array,
    clear: float,
    apart: npt.NDArray[np.bool_],
) -> None:
    """All cells (m, n) of a table: a block at a time, and where that is open its quarters."""
    rows, columns = apart.shape
    outer, joint = arm.pairs[pair, at.PAIR_OUTER], arm.pairs[pair, at.PAIR_OUTWARD]
    dof = arm.fixed.shape[0] - 1
    q, delta = np.zeros(dof), np.zeros(dof)
    stack = np.empty((64, 3), dtype=np.int64)
    for i in range(0, rows, _BLOCK_CELLS):
        for j in range(0, columns, _BLOCK_CELLS):
            stack[0, 0], stack[0, 1], stack[0, 2] = i, j, _BLOCK_CELLS
            waiting = 1
            while waiting > 0:
                waiting -= 1
                k, m, size = stack[waiting]
                # The block's middle, and half of what it spans.
                delta[joint] = 0.5 * min(size, rows - k) * CELL_RAD + _ROUNDING_RAD
                q[joint] = lower[0] + k * CELL_RAD + delta[joint]
                if columns > 1:
                    delta[joint + 1] = 0.5 * min(size, columns - m) * CELL_RAD + _ROUNDING_RAD
                    q[joint + 1] = lower[1] + m * CELL_RAD + delta[joint + 1]
                # What the pair keeps there, against all that may happen within the block.
                place_joints(arm, scratch, q)
                place_all_spheres(arm, scratch)
                bound_motion(arm, scratch, delta, scratch.bound)
                need = clear + scratch.bound[outer, joint]
                if (
                    spheres_apart(scratch, arm.pairs[pair], need)
                    or bodies_meet(arm, scratch, pair, need, need) == FREE
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
