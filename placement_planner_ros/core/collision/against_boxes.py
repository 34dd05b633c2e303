"""A moving body against the obstacle set, coarse to fine.

Spheres around the body and balls inside of it against the field of distance bounds, then the boxes
near the leaf spheres left open, then the direction that last kept a box away, then the distance
between set and box (`separation`), or between mesh and box. That a body keeps its distance is
certain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch
from placement_planner_ros.core.collision.placed_meshes import mesh_keeps_box
from placement_planner_ros.core.collision.placing import place_set
from placement_planner_ros.core.collision.separation import BOUND_TOLERANCE_M, sets_keep
from placement_planner_ros.core.reach.kinematics import to_world
from placement_planner_ros.core.types import Array, Index32
from placement_planner_ros.core.uncounted import Uncounted

SET_MOTION_M = 0.02
"""Metres of motion over an interval above which convex sets are not looked at: halves will tell."""
MESH_MOTION_M = 0.004
"""The like for meshes, which take longer."""


class KeptMargins(NamedTuple):
    """What a configuration is to keep, metres."""

    margin: float
    """From the obstacle set; `self_margin`: of the robot from itself."""
    self_margin: float
    contact: bool
    """Whether the held object is left out against the obstacle set."""


class BoxArrays(NamedTuple):
    """The obstacle set for the kernels: m boxes, each within its cell."""

    number: int
    columns: Index32
    """(nx, ny + 1): the boxes of the column of cells i, j are columns[i, j] to columns[i, j + 1].

    A few hundred kilobytes, where an index of all cells would be too much for the caches.
    """
    layers: Index32
    """(m,) cell of each box along z, ascending within a column."""
    corners: Array
    """(m, 6) lower then upper."""
    grid: Array
    """(4,) lower corner of the grid, and its cell size."""
    field_grid: Array
    """(10,) the like of the field, the shape, step and exact levels of
    `scene.distance.DistanceBound`, and cells per metre."""
    field: npt.NDArray[np.uint8]
    """Its levels."""
    tops: Array
    """(m,) heights of the boxes above a plane through the origin; empty where none is support."""
    support: Array
    """(4,) the support: height of the contact plane; how near to it tops are of boxes that it is;
    how far below a set boxes are no matter, and how far below the contact plane; metres."""


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def distance_bounds(
    grid: Array, field: npt.NDArray[np.uint8], x: float, y: float, z: float
) -> tuple[float, float]:
    """Lower and upper bound of the distance of a point to all boxes (`field_grid`, `field`).

    Those of the cell of the nearest point in the field, whose centre that is `off` away from
    (`scene.distance.DistanceBound`). A point `beyond` the field is so far from the nearest in it,
    and from no box at less than a right angle there, since all boxes are within.
    """
    # The point in cells of the field from its lower corner, and the nearest to it in the field.
    gx, gy, gz = (x - grid[0]) * grid[9], (y - grid[1]) * grid[9], (z - grid[2]) * grid[9]
    fx = min(gx if gx > 0.0 else 0.0, grid[4])
    fy = min(gy if gy > 0.0 else 0.0, grid[5])
    fz = min(gz if gz > 0.0 else 0.0, grid[6])
    gx, gy, gz = gx - fx, gy - fy, gz - fz
    # Its cell, and the level of that within its block of 4 x 4 x 4.
    i, j, k = int(min(fx, grid[4] - 1.0)), int(min(fy, grid[5] - 1.0)), int(min(fz, grid[6] - 1.0))
    level = field[i >> 2, j >> 2, k >> 2, (i & 3) << 4 | (j & 3) << 2 | k & 3]
    # How far that point is from the centre of its cell.
    fx -= i + 0.5
    fy -= j + 0.5
    fz -= k + 0.5
    off = grid[3] * np.sqrt(fx * fx + fy * fy + fz * fz)
    # The level bounds the distance of the centre; the point's differs by no more than it is off.
    lower = level * grid[7] - off
    upper = lower + 2.0 * off + grid[7] if level < grid[8] else np.inf
    square = gx * gx + gy * gy + gz * gz
    if square > 0.0:
        beyond = grid[3] * np.sqrt(square)
        lower = max(lower, 0.0)
        return np.sqrt(lower * lower + beyond * beyond), upper + beyond
    return lower, upper


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def reach_along_side(arm: ArmArrays, scratch: ArmScratch, s: int) -> None:
    """How far the vertices of set s reach along the direction that last kept a box away from it, in
    the frame of its joint: beside that in `sides`, infinite where none is known."""
    sides, vertices = scratch.sides, arm.vertices
    x, y, z = sides[s, 0], sides[s, 1], sides[s, 2]
    reach = -np.inf if x != 0.0 or y != 0.0 or z != 0.0 else np.inf
    for v in range(arm.sets[s, at.SET_FIRST_VERTEX], arm.sets[s + 1, at.SET_FIRST_VERTEX]):
        reach = max(reach, x * vertices[v, 0] + y * vertices[v, 1] + z * vertices[v, 2])
    sides[s, 3] = reach


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _face_side(arm: ArmArrays, scratch: ArmScratch, s: int, far: float) -> None:
    """Fill `side` with the direction that last kept a box away from set s, in the world, and from
    where along it boxes are `far`: nowhere where none is known."""
    frames, sides, side = scratch.frames, scratch.sides, scratch.side
    joint = arm.sets[s, at.SET_JOINT]
    side[3] = sides[s, 3] + arm.radius[s] + far
    # Turn the direction into the world, and add how far along it the joint is.
    for i in range(3):
        turned = frames[joint, i, 0] * sides[s, 0] + frames[joint, i, 1] * sides[s, 1]
        side[i] = turned + frames[joint, i, 2] * sides[s, 2]
        side[3] += side[i] * frames[joint, i, 3]


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _set_keeps_box(
    arm: ArmArrays, boxes: BoxArrays, scratch: ArmScratch, s: int, box: int, need: float
) -> bool:
    """Whether set s, placed, keeps `need` from one box; the direction in which is remembered.

    The distance is sought from the direction in `work` on, see `separation.sets_keep`.
    """
    sets, frames, work, joint = arm.sets, scratch.frames, scratch.work, arm.sets[s, at.SET_JOINT]
    first, last = sets[s, at.SET_FIRST_VERTEX], sets[s + 1, at.SET_FIRST_VERTEX]
    far = need + arm.radius[s]
    apart = sets_keep((scratch.vertices, first, last), (boxes.corners, box, box + 1), far, work)
    if apart:
        # From the set to the box, of unit length, in the frame of the set's joint.
        x, y, z = work[5, 0], work[5, 1], work[5, 2]
        length = np.sqrt(x * x + y * y + z * z)
        for i in range(3):
            along = frames[joint, 0, i] * x + frames[joint, 1, i] * y + frames[joint, 2, i] * z
            scratch.sides[s, i] = -along / length
        reach_along_side(arm, scratch, s)
        # What keeps this box away may keep its neighbours away.
        _face_side(arm, scratch, s, need + BOUND_TOLERANCE_M)
    return apart


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def leaves_keep_boxes(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    leaves: tuple[int, int],
    need: float,
    fine: bool,
) -> bool:
    """Whether what open leaf spheres of one set cover keeps `need` from the boxes in reach of them.

    Boxes are sought in the columns of cells below the leaves' span: those not far along the
    direction that last kept a box away from the set; then the set itself, or the mesh that it
    covers.

    Args:
        leaves: the first of the scratch's, and that behind the last.
        fine: whether meshes are asked where their covers come too near.
    """
    columns, layers, corners = boxes.columns, boxes.layers, boxes.corners
    spheres, bounds, side = arm.node_spheres, scratch.bounds, scratch.side
    ox, oy, oz, size = boxes.grid[0], boxes.grid[1], boxes.grid[2], boxes.grid[3]
    per_metre = 1.0 / size
    s = arm.nodes[scratch.leaves[leaves[0]], at.NODE_SET]
    joint, mesh = arm.sets[s, at.SET_JOINT], arm.sets[s, at.SET_MESH]
    # The span of the leaves' balls, which boxes must reach.
    far = need + BOUND_TOLERANCE_M
    x0 = y0 = z0 = np.inf
    x1 = y1 = z1 = -np.inf
    for k in range(leaves[0], leaves[1]):
        # Not those open for a motion alone that is not kept.
        if scratch.leaf_bounds[k] < need:
            node = scratch.leaves[k]
            x, y, z = to_world(
                scratch.frames, joint, spheres[node, 0], spheres[node, 1], spheres[node, 2]
            )
            reach = spheres[node, 3] + far
            x0, y0, z0 = min(x0, x - reach), min(y0, y - reach), min(z0, z - reach)
            x1, y1, z1 = max(x1, x + reach), max(y1, y + reach), max(z1, z + reach)
    if x0 > x1:
        return True
    # Put the set where it is, unless that was done.
    if scratch.set_stamp[s] < scratch.stamp[0]:
        scratch.set_stamp[s] = scratch.stamp[0]
        place_set(arm, scratch, s)
    _face_side(arm, scratch, s, far)
    # No more than the box around the set, grown.
    x0, x1 = max(x0, bounds[s, 0] - far), min(x1, bounds[s, 3] + far)
    y0, y1 = max(y0, bounds[s, 1] - far), min(y1, bounds[s, 4] + far)
    z0, z1 = max(z0, bounds[s, 2] - far), min(z1, bounds[s, 5] + far)
    # The columns of cells below the span.
    i0 = max(int(np.floor((x0 - ox) * per_metre)), 0)
    j0 = max(int(np.floor((y0 - oy) * per_metre)), 0)
    i1 = min(int(np.floor((x1 - ox) * per_metre)) + 1, columns.shape[0])
    j1 = min(int(np.floor((y1 - oy) * per_metre)) + 1, columns.shape[1] - 1)
    for i in range(i0, i1):
        low_x = ox + i * size
        for j in range(j0, j1):
            # The heights in question at which the column's nearest corner is not far along the
            # remembered direction.
            low_y, bottom, top = oy + j * size, z0, z1
            before = side[3] - side[0] * (low_x if side[0] > 0.0 else low_x + size)
            before -= side[1] * (low_y if side[1] > 0.0 else low_y + size)
            if side[2] > 0.0:
                top = min(top, before / side[2])
            elif side[2] < 0.0:
                bottom = max(bottom, before / side[2])
            if bottom > top:
                continue
            # The first box in or above the lowest of the layers between.
            k0 = int(np.floor((bottom - oz) * per_metre))
            k1 = int(np.floor((top - oz) * per_metre))
            first, last = columns[i, j], columns[i, j + 1]
            end = last
            while first < end:
                half = (first + end) // 2
                if layers[half] < k0:
                    first = half + 1
                else:
                    end = half
            for box in range(first, last):
                # Up to those of higher layers.
                if layers[box] > k1:
                    break
                # Skip boxes whose nearest corner is far along the remembered direction.
                if (
                    side[0] * corners[box, 0 if side[0] > 0.0 else 3]
                    + side[1] * corners[box, 1 if side[1] > 0.0 else 4]
                    + side[2] * corners[box, 2 if side[2] > 0.0 else 5]
                    >= side[3]
                ):
                    continue
                # Skip the support, and what is so far below that it is no matter.
                if len(boxes.tops) > 0:
                    above = boxes.tops[box] - boxes.support[0]
                    if (
                        abs(above) <= boxes.support[1]
                        or bounds[s, 2] - corners[box, 5] >= boxes.support[2]
                        or -above >= boxes.support[3]
                    ):
                        continue
                # The set itself against the box, from the line between their middles on.
                for k in range(3):
                    middle = corners[box, k] + corners[box, k + 3]
                    scratch.work[5, k] = bounds[s, k] + bounds[s, k + 3] - middle
                if not _set_keeps_box(arm, boxes, scratch, s, box, need) and not (
                    fine and mesh >= 0 and mesh_keeps_box(arm, scratch, mesh, corners, box, need)
                ):
                    scratch.hit[0], scratch.hit[1], scratch.hit[2] = 0, s, box
                    return False
    return True


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def bodies_keep_boxes(
    arm: ArmArrays, boxes: BoxArrays, scratch: ArmScratch, count: int, kept: KeptMargins
) -> bool:
    """Whether bodies, those among the first `count` items asked for, certainly keep the margin from
    the obstacle set.

    The scratch's `motion` says how far each moves, metres, of which much is left to shorter
    intervals; what is not kept of that beside the margin is set to 0.

    The field bounds the distance d of any point (`distance_bounds`). A sphere of radius r around
    the point holds a piece of the body: it is `need` away from all boxes where d - r ≥ `need`. A
    ball of radius i around the point lies inside the body: `need` is not kept where d - i < `need`.
    What neither settles down to the leaves of the tree is left to the boxes in their reach, once
    the field has been asked for all bodies: most collisions are found there.
    """
    if boxes.number == 0:
        return True
    sets, nodes, spheres = arm.sets, arm.nodes, arm.node_spheres
    frames, field_grid, field = scratch.frames, boxes.field_grid, boxes.field
    margin, leaves, opened, bodies = kept.margin, scratch.leaves, 0, 0
    while bodies < count and scratch.asked[bodies] < arm.moving:
        body = scratch.asked[bodies]
        scratch.leaf_ends[bodies] = opened
        bodies += 1
        if kept.contact and body == arm.held:
            continue
        motion = scratch.motion[body]
        joint, ball = arm.bodies[body, at.BODY_JOINT], arm.body_spheres[body]
        first, last = arm.bodies[body, at.BODY_FIRST_SET], arm.bodies[body + 1, at.BODY_FIRST_SET]
        # The sphere around all sets; that around a single one is the root of its tree.
        if last - first > 1:
            x, y, z = to_world(frames, joint, ball[0], ball[1], ball[2])
            lower, _ = distance_bounds(field_grid, field, x, y, z)
            if lower >= ball[3] + margin + motion + BOUND_TOLERANCE_M:
                continue
        # The trees of all sets in preorder.
        node, end = sets[first, at.SET_FIRST_NODE], sets[last, at.SET_FIRST_NODE]
        while node < end:
            # Bounds on the distance of the node's centre to all boxes.
            x, y, z = to_world(frames, joint, spheres[node, 0], spheres[node, 1], spheres[node, 2])
            lower, upper = distance_bounds(field_grid, field, x, y, z)
            lower -= spheres[node, 3] + BOUND_TOLERANCE_M
            upper -= spheres[node, 4] - BOUND_TOLERANCE_M
            # The sphere keeps its distance: skip all that is below it.
            if lower >= margin + motion:
                node = nodes[node, at.NODE_SKIP]
                continue
            # The ball inside does not.
            if upper < margin:
                scratch.hit[0], scratch.hit[1] = 2, node
                return False
            # Nor the motion, or that is too large to look at sets: only the margin may be kept.
            leaf = nodes[node, at.NODE_SET] >= 0
            if motion > 0.0 and (upper < margin + motion or (leaf and motion > SET_MOTION_M)):
                motion = 0.0
                continue
            # A leaf stays open.
            if leaf:
                leaves[opened], scratch.leaf_bounds[opened] = node, lower
                opened += 1
            node += 1
        scratch.motion[body] = motion
    scratch.leaf_ends[bodies] = opened
    # What is left open of each body, set by set, against boxes.
    for asked in range(bodies):
        body = scratch.asked[asked]
        motion, k, end = (
            scratch.motion[body],
            scratch.leaf_ends[asked],
            scratch.leaf_ends[asked + 1],
        )
        while k < end:
            s, last = nodes[leaves[k], at.NODE_SET], k + 1
            while last < end and nodes[leaves[last], at.NODE_SET] == s:
                last += 1
            fine = motion <= MESH_MOTION_M
            if leaves_keep_boxes(arm, boxes, scratch, (k, last), margin + motion, fine):
                k = last
            elif motion > 0.0:
                # Once more, for the margin alone.
                scratch.motion[body] = motion = 0.0
            else:
                return False
    return True
