"""A moving body against the obstacle set, coarse to fine.

Spheres against the field of distance bounds, then the cells near a leaf sphere, then the face
planes of the convex set, then the distance between set and box (`separation`). Every answer but
UNDECIDED is certain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.robot.collision_arrays import (
    BODY_FIRST_PART,
    BODY_JOINT,
    NODE_FIRST,
    NODE_LAST,
    NODE_SKIP,
    PART_FIRST_NODE,
    PART_SOLID,
    SET_EXACT,
    SET_FIRST_PLANE,
    SET_FIRST_VERTEX,
    ArmArrays,
    ArmScratch,
)
from placement_planner_ros.core.robot.collision_placing import (
    note_undecided,
    place_planes,
    place_set,
    to_world,
)
from placement_planner_ros.core.robot.separation import (
    COLLIDING,
    FREE,
    TOLERANCE,
    UNDECIDED,
    separate_box,
)
from placement_planner_ros.core.types import Array

COARSE = 0.02
"""Metres of motion above which an interval is searched for collisions rather than certified."""


class BoxArrays(NamedTuple):
    """The obstacle set for the kernels: m boxes, each within its cell."""

    number: int
    rows: npt.NDArray[np.int32]
    """(nx, ny, nz) cell to its first box, or -1."""
    next: npt.NDArray[np.int32]
    """(m,) another box of the same cell, or -1."""
    corners: Array
    """(m, 6) lower then upper."""
    grid: Array
    """(4,) lower corner of the grid, and its cell size."""
    field_grid: Array
    """(10,) the like of the field, then the box around all boxes, lower and upper."""
    field: npt.NDArray[np.float32]
    """Lower bound of the distance at each cell's centre."""


@njit(cache=True, inline="always")
def distance_bound(
    grid: Array, field: npt.NDArray[np.float32], x: float, y: float, z: float
) -> float:
    """A lower bound of the distance of a point to all boxes (`field_grid`, `field`)."""
    size = grid[3]
    fx = (x - grid[0]) / size
    fy = (y - grid[1]) / size
    fz = (z - grid[2]) / size
    i = int(np.floor(fx))
    j = int(np.floor(fy))
    k = int(np.floor(fz))
    if 0 <= i < field.shape[0] and 0 <= j < field.shape[1] and 0 <= k < field.shape[2]:
        fx -= i + 0.5
        fy -= j + 0.5
        fz -= k + 0.5
        return field[i, j, k] - size * np.sqrt(fx * fx + fy * fy + fz * fz)
    dx = max(grid[4] - x, 0.0, x - grid[7])
    dy = max(grid[5] - y, 0.0, y - grid[8])
    dz = max(grid[6] - z, 0.0, z - grid[9])
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@njit(cache=True)
def polytope_meets_box(
    vertices: Array,
    first_vertex: int,
    last_vertex: int,
    planes: Array,
    first_plane: int,
    last_plane: int,
    closed: bool,
    bounds: Array,
    row: int,
    radius: float,
    corners: Array,
    box: int,
    need: float,
    hit: float,
    work: Array,
) -> int:
    """A convex set in the world against one box: FREE from distance `need`, COLLIDING below `hit`.

    Args:
        vertices, planes: (v, 3), (p, 4) of which the set's rows are the ranges given.
        closed: whether the planes enclose the set and nothing more.
        bounds: (s, 6), of which `row` is the box around the set, its radius included.
        corners: (m, 6), of which `box` is the box.
    """
    far = need + TOLERANCE
    for i in range(3):
        if (
            corners[box, i] - bounds[row, i + 3] >= far
            or bounds[row, i] - corners[box, i + 3] >= far
        ):
            return FREE
    cx = 0.5 * (corners[box, 0] + corners[box, 3])
    cy = 0.5 * (corners[box, 1] + corners[box, 4])
    cz = 0.5 * (corners[box, 2] + corners[box, 5])
    hx = corners[box, 3] - cx
    hy = corners[box, 4] - cy
    hz = corners[box, 5] - cz
    far += radius
    deepest = -np.inf
    best = -np.inf
    axis = -1
    for v in range(first_plane, last_plane):
        nx, ny, nz = planes[v, 0], planes[v, 1], planes[v, 2]
        middle = nx * cx + ny * cy + nz * cz - planes[v, 3]
        gap = middle - abs(nx) * hx - abs(ny) * hy - abs(nz) * hz
        if gap >= far:
            return FREE
        deepest = max(deepest, middle)
        if gap > best:
            best = gap
            axis = v
    if axis >= 0:
        if closed and deepest < -TOLERANCE:
            return COLLIDING
        work[5, 0], work[5, 1], work[5, 2] = -planes[axis, 0], -planes[axis, 1], -planes[axis, 2]
    else:
        work[5, 0] = bounds[row, 0] + bounds[row, 3] - 2 * cx
        work[5, 1] = bounds[row, 1] + bounds[row, 4] - 2 * cy
        work[5, 2] = bounds[row, 2] + bounds[row, 5] - 2 * cz
    return separate_box(
        vertices,
        first_vertex,
        last_vertex,
        corners,
        box,
        need + radius,
        hit + radius,
        work,
    )


@njit(cache=True)
def body_meets_boxes(
    arm: ArmArrays, boxes: BoxArrays, scratch: ArmScratch, body: int, need: float, hit: float
) -> int:
    """A moving body against the obstacle set; what is left UNDECIDED is noted in the scratch.

    Where `need` is far above `hit`, or cannot be kept any more, only collisions are looked for.
    """
    field, field_grid = boxes.field, boxes.field_grid
    rows, corners, following = boxes.rows, boxes.corners, boxes.next
    nodes, spheres, frames = arm.nodes, arm.node_spheres, scratch.frames
    parts, sets = arm.parts, arm.sets
    set_stamp, plane_stamp = scratch.set_stamp, scratch.plane_stamp
    box_stamp, counters = scratch.box_stamp, scratch.counters
    vertices, planes, bounds, work = (
        scratch.vertices,
        scratch.planes,
        scratch.bounds,
        scratch.work,
    )
    joint = arm.bodies[body, BODY_JOINT]
    ox, oy, oz, size = boxes.grid[0], boxes.grid[1], boxes.grid[2], boxes.grid[3]
    nx, ny, nz = rows.shape
    now = counters[0]
    near = need
    result = FREE
    if need - hit > COARSE:
        near = hit
    for part in range(arm.bodies[body, BODY_FIRST_PART], arm.bodies[body + 1, BODY_FIRST_PART]):
        solid = parts[part, PART_SOLID] != 0
        if solid:
            counters[1] += 1
        node = parts[part, PART_FIRST_NODE]
        end = parts[part + 1, PART_FIRST_NODE]
        while node < end:
            x, y, z = to_world(frames, joint, spheres[node, 0], spheres[node, 1], spheres[node, 2])
            radius = spheres[node, 3]
            bound = distance_bound(field_grid, field, x, y, z) - radius - TOLERANCE
            if bound >= need or (result == UNDECIDED and bound >= near):
                node = nodes[node, NODE_SKIP]
                continue
            if nodes[node, NODE_FIRST] < 0:
                node += 1
                continue
            if near < need:
                result = UNDECIDED
                if bound >= near:
                    node = nodes[node, NODE_SKIP]
                    continue
            if not solid:
                counters[1] += 1
            visit = counters[1]
            reach = radius + near + TOLERANCE
            i0 = max(int(np.floor((x - reach - ox) / size)), 0)
            j0 = max(int(np.floor((y - reach - oy) / size)), 0)
            k0 = max(int(np.floor((z - reach - oz) / size)), 0)
            i1 = min(int(np.floor((x + reach - ox) / size)) + 1, nx)
            j1 = min(int(np.floor((y + reach - oy) / size)) + 1, ny)
            k1 = min(int(np.floor((z + reach - oz) / size)) + 1, nz)
            for i in range(i0, i1):
                for j in range(j0, j1):
                    for k in range(k0, k1):
                        box = rows[i, j, k]
                        while box >= 0:
                            this = box
                            box = following[box]
                            if box_stamp[this] == visit:
                                continue
                            dx = max(corners[this, 0] - x, 0.0, x - corners[this, 3])
                            dy = max(corners[this, 1] - y, 0.0, y - corners[this, 4])
                            dz = max(corners[this, 2] - z, 0.0, z - corners[this, 5])
                            if dx * dx + dy * dy + dz * dz > reach * reach:
                                continue
                            box_stamp[this] = visit
                            for s in range(nodes[node, NODE_FIRST], nodes[node, NODE_LAST]):
                                if set_stamp[s] < now:
                                    set_stamp[s] = now
                                    place_set(arm, scratch, s)
                                if plane_stamp[s] < now:
                                    plane_stamp[s] = now
                                    place_planes(arm, scratch, s)
                                answer = polytope_meets_box(
                                    vertices,
                                    sets[s, SET_FIRST_VERTEX],
                                    sets[s + 1, SET_FIRST_VERTEX],
                                    planes,
                                    sets[s, SET_FIRST_PLANE],
                                    sets[s + 1, SET_FIRST_PLANE],
                                    True,
                                    bounds,
                                    s,
                                    arm.radius[s],
                                    corners,
                                    this,
                                    near,
                                    hit,
                                    work,
                                )
                                if answer == COLLIDING and sets[s, SET_EXACT] != 0:
                                    scratch.hit[0] = 0
                                    scratch.hit[1] = s
                                    scratch.hit[2] = this
                                    return COLLIDING
                                if answer != FREE:
                                    result = UNDECIDED
                                    near = hit
                                    note_undecided(scratch.undecided, counters, 0, s, this)
            node = nodes[node, NODE_SKIP]
    return result
