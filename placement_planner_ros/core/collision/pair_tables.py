"""Tables of pairs of links with one or two turning joints between them: where these are apart.

How such a pair lies depends on two angles at most, so their plane is divided into cells. A cell
says how many cells away the nearest is in which the links may come near each other, which
`against_robot.tabled_apart` asks. Tables depend on the robot alone: they are kept on disk and
shared by all checkers of it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, lru_cache, partial

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.ndimage import distance_transform_cdt

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_robot import pairs_keep
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch, FlatArm, scratch_for
from placement_planner_ros.core.collision.edges import bound_motion
from placement_planner_ros.core.collision.placing import place_joints, place_spheres
from placement_planner_ros.core.disk_cache import code_digest, digest_of, recalled_result
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array, Mask


def with_pair_tables(flat: FlatArm, chain: Chain, clear: float) -> FlatArm:
    """The same arm with a table for each pair of rigid links up to two turning joints apart.

    Args:
        clear: what tables certify, metres.
    """
    arrays, scratch = flat.arrays, scratch_for(flat)
    tables: list[bytes] = []
    pairs, lower = arrays.pairs.copy(), np.zeros((len(arrays.pairs), 2))
    digest_of_body = cache(flat.digest)
    for row, (a, b, *_) in enumerate(arrays.pairs.tolist()):
        # The joints between both, which have limits and turn.
        inner, outer = flat.bodies[a], flat.bodies[b]
        joints = slice(max(inner.joint, -1) + 1, outer.joint + 1)
        spans = chain.upper[joints] - chain.lower[joints]
        if len(spans) > 2 or not (inner.rigid and outer.rigid) or chain.prismatic[joints].any():
            continue
        # A joint that turns by less than a cell would be no axis of the table.
        if not ((spans >= at.CELL_RAD) & (spans < np.inf)).all():
            continue
        limits = np.column_stack([chain.lower[joints], chain.upper[joints]])
        step(f"tabling links {inner.name} and {outer.name}")
        shape = (*((spans / at.CELL_RAD).astype(np.int64) + 1).tolist(), 1)[:2]
        lower[row, : len(spans)] = limits[:, 0]
        digests = map(digest_of_body, (a, b))
        key = digest_of(code_digest(__name__), clear, limits, chain.fixed[joints], *digests)
        make = partial(_cells_away, arrays, scratch, row, lower[row], clear, shape)
        # One more table behind the others.
        pairs[row, at.PAIR_ROWS :] = *shape, sum(len(table) for table in tables)
        tables.append(recalled_result("pair tables", key, make))
    made = arrays._replace(
        pairs=pairs, pair_lower=lower, tables=_joined_tables(tuple(tables)), clear=clear
    )
    return replace(flat, arrays=made)


@lru_cache(maxsize=8)
def _joined_tables(tables: tuple[bytes, ...]) -> npt.NDArray[np.uint8]:
    """One after the other; an arm has the same with whatever it holds."""
    return np.frombuffer(b"".join(tables), np.uint8)


def _cells_away(
    arm: ArmArrays,
    scratch: ArmScratch,
    pair: int,
    lower: Array,
    clear: float,
    shape: tuple[int, ...],
) -> bytes:
    """Of each cell (m, n) how many cells away the nearest is that is not apart, or not there."""
    apart = np.zeros(shape, np.bool_)
    _fill_table(arm, scratch, pair, lower, clear, apart)
    around = 1, int(shape[1] > 1)
    away = distance_transform_cdt(np.pad(apart, [(k, k) for k in around]), "chessboard")
    away = away[1:-1, around[1] : around[1] + shape[1]]
    return np.minimum(away, 255).astype(np.uint8).tobytes()


@njit(cache=True, nogil=True)
def _fill_table(
    arm: ArmArrays, scratch: ArmScratch, pair: int, lower: Array, clear: float, apart: Mask
) -> None:
    """All cells (m, n) of a table: the whole of it, and where that is open its quarters."""
    rows, columns = apart.shape
    outer, joint = arm.pairs[pair, at.PAIR_OUTER], arm.pairs[pair, at.PAIR_OUTWARD]
    dof = arm.fixed.shape[0] - 1
    q, delta = np.zeros(dof), np.zeros(dof)
    # Only this pair is asked for, at a configuration.
    asked = scratch.asked[:1]
    asked[0] = arm.moving + pair
    scratch.motion[arm.moving + pair] = 0.0
    # Blocks that wait: first row, first column, cells along each side.
    stack = np.zeros((64, 3), dtype=np.int64)
    stack[0, 2] = 2 ** int(np.ceil(np.log2(max(rows, columns))))
    waiting = 1
    while waiting > 0:
        waiting -= 1
        k, m, size = stack[waiting]
        # The block's middle, and half of what it spans, and a bit.
        for i in range(1 if columns == 1 else 2):
            first, count = (k, rows) if i == 0 else (m, columns)
            delta[joint + i] = 0.5 * min(size, count - first) * at.CELL_RAD + 1e-9
            q[joint + i] = lower[i] + first * at.CELL_RAD + delta[joint + i]
        # What the pair keeps there, against all that may happen within the block.
        place_joints(arm, scratch, q)
        place_spheres(arm, scratch, arm.moving)
        bound_motion(arm, scratch, delta, scratch.bound)
        if pairs_keep(arm, scratch, len(asked), clear + scratch.bound[outer, joint]):
            apart[k : k + size, m : m + size] = True
        elif size > 1:
            # The block's quarters, those that begin within the table.
            half = size // 2
            for corner in range(4):
                k2, m2 = k + half * (corner % 2), m + half * (corner // 2)
                if k2 < rows and m2 < columns:
                    stack[waiting, 0], stack[waiting, 1], stack[waiting, 2] = k2, m2, half
                    waiting += 1
