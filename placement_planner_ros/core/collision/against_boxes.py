"""A moving body against the obstacle set, coarse to fine.

Spheres around the body and balls inside of it against the field of distance bounds, then the boxes
near the leaf spheres left open, then the face planes of the convex set, then the distance between
set and box (`separation`). Every answer but UNDECIDED is certain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.against_mesh import COARSE_MOTION_M
from placement_planner_ros.core.collision.arrays import ArmArrays, ArmScratch
from placement_planner_ros.core.collision.placed_meshes import mesh_meets_box
from placement_planner_ros.core.collision.placing import (
    note_hit,
    place_planes,
    place_set,
)
from placement_planner_ros.core.collision.separation import (
    BOUND_TOLERANCE_M,
    COLLIDING,
    FREE,
    UNDECIDED,
    check_separation,
)
from placement_planner_ros.core.reach.kinematics import to_world
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.uncounted import Uncounted


class BoxArrays(NamedTuple):
    """The obstacle set for the kernels: m boxes, each within its cell."""

    number: int
    columns: npt.NDArray[np.int32]
    """(nx, ny + 1): the boxes of the column of cells i, j are columns[i, j] to columns[i, j + 1].

    A few hundred kilobytes, where an index of all cells would be too much for the caches.
    """
    layers: npt.NDArray[np.int32]
    """(m,) cell of each box along z, ascending within a column."""
    corners: Array
    """(m, 6) lower then upper."""
    grid: Array
    """(4,) lower corner of the grid, and its cell size."""
    field_grid: Array
    """(16,) the like of the field, the box around all boxes, lower and upper, the shape, step and
    exact levels of `scene.distance_bound.DistanceBound`, and cells per metre."""
    field: npt.NDArray[np.uint8]
    """Its levels."""
    tops: Array
    """(m,) heights of the boxes above a plane through the origin; empty where none is support."""
    support: Array
    """(4,) the support: height of the contact plane; how near to it tops are of boxes that it is;
    how far below a set boxes are no matter, and how far below the contact plane; metres."""


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def distance_bounds(
    grid: Array, field: npt.NDArray[np.uint8], x: float, y: float, z: float
) -> tuple[float, float]:
    """Lower and upper bound of the distance of a point to all boxes (`field_grid`, `field`).

    Inside the grid, those of the point's cell, whose centre it is `off` away from
    (`scene.distance_bound.DistanceBound`); outside, the distance to the box around all boxes.
    """
    # The point in cells of the field from its lower corner.
    fx = (x - grid[0]) * grid[15]
    fy = (y - grid[1]) * grid[15]
    fz = (z - grid[2]) * grid[15]
    if 0.0 <= fx < grid[10] and 0.0 <= fy < grid[11] and 0.0 <= fz < grid[12]:
        # The cell, and its level within its block of 4 x 4 x 4.
        i, j, k = int(fx), int(fy), int(fz)
        level = field[i >> 2, j >> 2, k >> 2, (i & 3) << 4 | (j & 3) << 2 | k & 3]
        # How far the point is from the centre of its cell.
        fx -= i + 0.5
        fy -= j + 0.5
        fz -= k + 0.5
        off = grid[3] * np.sqrt(fx * fx + fy * fy + fz * fz)
        # The level bounds the distance of the centre; the point's differs by no more than it is
        # off.
        lower = level * grid[13]
        return lower - off, (lower + grid[13] + off if level < grid[14] else np.inf)
    # Outside the field: the distance to the box around all boxes, which bounds only from below.
    dx = max(grid[4] - x, 0.0, x - grid[7])
    dy = max(grid[5] - y, 0.0, y - grid[8])
    dz = max(grid[6] - z, 0.0, z - grid[9])
    return np.sqrt(dx * dx + dy * dy + dz * dz), np.inf


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def layer_range(
    layers: npt.NDArray[np.int32], first: int, last: int, low: int, high: int
) -> tuple[int, int]:
    """Which of the boxes first..last of one column lie in the layers low..high (not included)."""
    # Bisect for the first box in the layers from `low` on.
    end = last
    while first < end:
        middle = (first + end) // 2
        if layers[middle] < low:
            first = middle + 1
        else:
            end = middle
    # From there, the boxes up to the layer `high`.
    end = first
    while end < last and layers[end] < high:
        end += 1
    return first, end


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _is_support(boxes: BoxArrays, box: int, lowest: float) -> bool:
    """Whether a box is support, or so far below that it is no matter.

    Args:
        lowest: height that nothing of the set is below.
    """
    above = boxes.tops[box] - boxes.support[0]
    return bool(
        abs(above) <= boxes.support[1]
        or lowest - boxes.corners[box, 5] >= boxes.support[2]
        or -above >= boxes.support[3]
    )


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def boxes_apart(bounds: Array, row: int, corners: Array, box: int, need: float) -> bool:
    """Whether the box around a set, row of `bounds`, is `need` from an obstacle along an axis."""
    far = need + BOUND_TOLERANCE_M
    return bool(
        corners[box, 0] - bounds[row, 3] >= far
        or bounds[row, 0] - corners[box, 3] >= far
        or corners[box, 1] - bounds[row, 4] >= far
        or bounds[row, 1] - corners[box, 4] >= far
        or corners[box, 2] - bounds[row, 5] >= far
        or bounds[row, 2] - corners[box, 5] >= far
    )


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _polytope_meets_box(
    arm: ArmArrays,
    scratch: ArmScratch,
    s: int,
    corners: Array,
    box: int,
    margins: tuple[float, float],
) -> int:
    """Convex set s, placed, against one box: FREE from distance `need`, COLLIDING below `hit`.

    A face plane with all of the box `need` beyond it keeps them apart: along its normal n the box
    reaches down to n·c - |n|·h, with centre c and half extents h. A box whose centre lies below all
    planes collides, where they enclose the set and nothing more. Else the distance decides, sought
    from the plane on that the box is furthest beyond.

    Args:
        corners: (m, 6), of which `box` is the box.
        margins: `need` and `hit`.

    Returns:
        the answer; after FREE, work[5, 3] is the plane that keeps them apart, or -1.
    """
    # Centre and half extents of the box.
    planes, work, radius, sets = scratch.planes, scratch.work, arm.radius[s], arm.sets
    need, hit = margins
    work[5, 3] = -1.0
    cx = 0.5 * (corners[box, 0] + corners[box, 3])
    cy = 0.5 * (corners[box, 1] + corners[box, 4])
    cz = 0.5 * (corners[box, 2] + corners[box, 5])
    hx = corners[box, 3] - cx
    hy = corners[box, 4] - cy
    hz = corners[box, 5] - cz
    far = need + BOUND_TOLERANCE_M + radius
    deepest = -np.inf
    best = -np.inf
    axis = -1
    # How far centre and box lie beyond each face plane of the set.
    for v in range(sets[s, at.SET_FIRST_PLANE], sets[s + 1, at.SET_FIRST_PLANE]):
        nx, ny, nz = planes[v, 0], planes[v, 1], planes[v, 2]
        middle = nx * cx + ny * cy + nz * cz - planes[v, 3]
        gap = middle - abs(nx) * hx - abs(ny) * hy - abs(nz) * hz
        # All of the box lies far enough beyond this plane.
        if gap >= far:
            work[5, 3] = v
            return FREE
        deepest = max(deepest, middle)
        # Keep the plane that the box lies furthest beyond.
        if gap > best:
            best = gap
            axis = v
    if axis >= 0:
        # The centre lies below all planes, so inside the set.
        # The planes enclose the set, and nothing more unless it is swept.
        if scratch.sweep[0] == 0.0 and deepest < -BOUND_TOLERANCE_M:
            return COLLIDING
        # Start from that plane's normal, from the box to the set.
        work[5, 0], work[5, 1], work[5, 2] = -planes[axis, 0], -planes[axis, 1], -planes[axis, 2]
    else:
        # A set without planes: start from the line between the centres.
        bounds = scratch.bounds
        work[5, 0] = bounds[s, 0] + bounds[s, 3] - 2 * cx
        work[5, 1] = bounds[s, 1] + bounds[s, 4] - 2 * cy
        work[5, 2] = bounds[s, 2] + bounds[s, 5] - 2 * cz
    # The distance between the hull of the vertices and the box, with the radius added.
    return check_separation(
        scratch.vertices,
        sets[s, at.SET_FIRST_VERTEX],
        sets[s + 1, at.SET_FIRST_VERTEX],
        corners,
        box,
        box + 1,
        need + radius,
        hit + radius,
        work,
    )


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def open_leaves(
    arm: ArmArrays,
    boxes: BoxArrays,
    scratch: ArmScratch,
    bodies_asked: tuple[int, int, int],
    need: float,
    hit: float,
) -> tuple[int, int]:
    """Moving bodies against the field alone.

    The field bounds the distance d of any point (`distance_bounds`). A sphere of radius r around
    the point holds a piece of the body: it is `need` away from all boxes where d - r ≥ `need`. A
    ball of radius i around the point lies inside the body: it is closer than `hit` where
    d - i < `hit`. What neither settles down to the leaves of the tree is left open.

    Where `need` is far above `hit`, or cannot be kept any more, only collisions are looked for.

    Args:
        bodies_asked: the first, the one after the last, and one that is left out.

    Returns:
        FREE (but for the open leaves), COLLIDING, or UNDECIDED where only collisions were looked
        for; and how many leaves of the scratch are open.
    """
    bodies, body_spheres, sets = arm.bodies, arm.body_spheres, arm.sets
    nodes, spheres, inner = arm.nodes, arm.node_spheres, arm.node_inner
    frames, leaves, leaf_bound = scratch.frames, scratch.leaves, scratch.leaf_bound
    field_grid, field = boxes.field_grid, boxes.field
    count = 0
    result = FREE
    first_body, last_body, left_out = bodies_asked
    for body in range(first_body, last_body):
        if body == left_out:
            continue
        joint = bodies[body, at.BODY_JOINT]
        first, last = bodies[body, at.BODY_FIRST_SET], bodies[body + 1, at.BODY_FIRST_SET]
        # The sphere around all sets; that around a single one is the root of its tree.
        if last - first > 1:
            x, y, z = to_world(
                frames, joint, body_spheres[body, 0], body_spheres[body, 1], body_spheres[body, 2]
            )
            lower, _ = distance_bounds(field_grid, field, x, y, z)
            if lower >= body_spheres[body, 3] + need + BOUND_TOLERANCE_M:
                continue
        # The trees of all sets in preorder.
        node = sets[first, at.SET_FIRST_NODE]
        end = sets[last, at.SET_FIRST_NODE]
        while node < end:
            # Bounds on the distance of the node's centre to all boxes.
            x, y, z = to_world(frames, joint, spheres[node, 0], spheres[node, 1], spheres[node, 2])
            lower, upper = distance_bounds(field_grid, field, x, y, z)
            lower -= spheres[node, 3] + BOUND_TOLERANCE_M
            # The sphere keeps its distance: skip all that is below it.
            if lower >= need:
                node = nodes[node, at.NODE_SKIP]
                continue
            upper -= inner[node] - BOUND_TOLERANCE_M
            if upper < need:
                # The ball inside the body is closer than `hit`.
                if upper < hit:
                    note_hit(scratch, 2, node, 0)
                    return COLLIDING, count
                # Part of the body is closer than `need`: only collisions can be found from here on.
                result = UNDECIDED
                need = hit
            if nodes[node, at.NODE_SET] >= 0:
                # The field leaves a leaf open with a distance far above `hit`: look for collisions
                # only.
                if need - hit > COARSE_MOTION_M:
                    result = UNDECIDED
                    need = hit
                    if lower >= need:
                        node = nodes[node, at.NODE_SKIP]
                        continue
                # The leaf stays open.
                leaves[count] = node
                leaf_bound[count] = lower
                count += 1
            node += 1
    return result, count


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _plane_in_world(
    arm: ArmArrays, scratch: ArmScratch, s: int, plane: int, need: float
) -> tuple[float, float, float, float]:
    """Normal of a plane of set s, and from which offset along it points are `need` away from s."""
    frames, joint, planes = scratch.frames, arm.sets[s, at.SET_JOINT], arm.planes
    # Turn the normal into the world.
    x, y, z = planes[plane, 0], planes[plane, 1], planes[plane, 2]
    nx = frames[joint, 0, 0] * x + frames[joint, 0, 1] * y + frames[joint, 0, 2] * z
    ny = frames[joint, 1, 0] * x + frames[joint, 1, 1] * y + frames[joint, 1, 2] * z
    nz = frames[joint, 2, 0] * x + frames[joint, 2, 1] * y + frames[joint, 2, 2] * z
    # The offset along it, moved by the joint's position.
    offset = planes[plane, 3]
    offset += nx * frames[joint, 0, 3] + ny * frames[joint, 1, 3] + nz * frames[joint, 2, 3]
    return nx, ny, nz, offset + (need + BOUND_TOLERANCE_M + arm.radius[s])


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def _set_meets_box(
    arm: ArmArrays, boxes: BoxArrays, scratch: ArmScratch, s: int, box: int, need: float, hit: float
) -> int:
    """Set s of a moving body against one box; a plane that keeps them apart is remembered.

    Where the set is part of a cover, that only says what is free, or by how much more than its
    excess `need` cannot be kept; the rest is left to the mesh.
    """
    sets = arm.sets
    # The set collides below `hit`; a cover below what its excess cannot explain.
    mesh = sets[s, at.SET_MESH]
    short = need - arm.excess[s]
    closer = hit
    if mesh >= 0:
        closer = short if short > hit else 0.0
    # Its planes are put where they are when the first box asks for them.
    if scratch.plane_stamp[s] < scratch.counters[0]:
        scratch.plane_stamp[s] = scratch.counters[0]
        place_planes(arm, scratch, s)
    # The convex set against the box.
    answer = _polytope_meets_box(arm, scratch, s, boxes.corners, box, (need, closer))
    if answer == FREE:
        # Remember the plane that keeps the box away.
        if scratch.work[5, 3] >= 0.0:
            scratch.plane[s] = int(scratch.work[5, 3])
        return FREE
    # A cover that meets the box: it is the mesh that decides, once for all of its sets.
    if mesh >= 0:
        placement = scratch.counters[0] * arm.meshes.shape[0] + mesh
        if scratch.mesh_stamp[box] == placement:
            scratch.work[5, 3] = -1.0
            return FREE
        if answer == COLLIDING and short > hit:
            answer = UNDECIDED
        else:
            answer = mesh_meets_box(arm, scratch, mesh, (boxes.corners, box), need, hit)
            scratch.work[5, 3] = -1.0
            if answer == FREE:
                scratch.mesh_stamp[box] = placement
    if answer != FREE:
        note_hit(scratch, 0, s, box)
    return answer


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def open_leaves_meet_boxes(
    arm: ArmArrays, boxes: BoxArrays, scratch: ArmScratch, count: int, need: float, hit: float
) -> int:
    """What the first `count` open leaves cover against the boxes in reach of them.

    Boxes are sought in the columns of cells below the leaf's ball: those within the ball, near the
    box around the set, and not beyond the plane that last kept a box away from the set, for what
    lies beyond a face plane by `need` is at least that far away; then the set itself.

    Once `need` cannot be kept any more, only collisions are looked for. What is left UNDECIDED is
    noted as `hit`.
    """
    columns, layers, corners = boxes.columns, boxes.layers, boxes.corners
    nodes, spheres, sets = arm.nodes, arm.node_spheres, arm.sets
    counters, bounds = scratch.counters, scratch.bounds
    ox, oy, oz, size = boxes.grid[0], boxes.grid[1], boxes.grid[2], boxes.grid[3]
    per_metre = 1.0 / size
    result = FREE
    previous = -1
    for leaf in range(count):
        # The field has shown that this leaf keeps its distance.
        if scratch.leaf_bound[leaf] >= need:
            continue
        node = scratch.leaves[leaf]
        s = nodes[node, at.NODE_SET]
        # A set looks at a box once, whichever of its leaves reach it, and is placed once.
        if s != previous:
            previous = s
            counters[1] += 1
            if scratch.set_stamp[s] < counters[0]:
                scratch.set_stamp[s] = counters[0]
                place_set(arm, scratch, s)
        visit = counters[1]
        # The plane that last kept a box away from this set.
        plane = scratch.plane[s]
        nx = ny = nz = offset = 0.0
        if plane >= 0:
            nx, ny, nz, offset = _plane_in_world(arm, scratch, s, plane, need)
        # The ball that boxes must reach, and its span, no more than the box around the set, grown.
        far = need + BOUND_TOLERANCE_M
        x, y, z = to_world(
            scratch.frames,
            sets[s, at.SET_JOINT],
            spheres[node, 0],
            spheres[node, 1],
            spheres[node, 2],
        )
        reach = spheres[node, 3] + far
        x0, x1 = max(x - reach, bounds[s, 0] - far), min(x + reach, bounds[s, 3] + far)
        y0, y1 = max(y - reach, bounds[s, 1] - far), min(y + reach, bounds[s, 4] + far)
        z0, z1 = max(z - reach, bounds[s, 2] - far), min(z + reach, bounds[s, 5] + far)
        # The columns of cells below the span.
        i0 = max(int(np.floor((x0 - ox) * per_metre)), 0)
        j0 = max(int(np.floor((y0 - oy) * per_metre)), 0)
        i1 = min(int(np.floor((x1 - ox) * per_metre)) + 1, columns.shape[0])
        j1 = min(int(np.floor((y1 - oy) * per_metre)) + 1, columns.shape[1] - 1)
        for i in range(i0, i1):
            # Distance of the column from the ball's centre, along x.
            low_x = ox + i * size
            dx = max(low_x - x, 0.0, x - low_x - size)
            for j in range(j0, j1):
                # The column's distance along y, and half the height of the ball above the column.
                low_y = oy + j * size
                dy = max(low_y - y, 0.0, y - low_y - size)
                height = np.sqrt(max(reach * reach - dx * dx - dy * dy, 0.0)) + BOUND_TOLERANCE_M
                # The layers between the lowest and the highest point in question.
                k0 = int(np.floor((max(z - height, z0) - oz) * per_metre))
                k1 = int(np.floor((min(z + height, z1) - oz) * per_metre)) + 1
                first, last = layer_range(layers, columns[i, j], columns[i, j + 1], k0, k1)
                for box in range(first, last):
                    # Skip boxes outside the ball, and those looked at for this set already.
                    u = max(corners[box, 0] - x, 0.0, x - corners[box, 3])
                    v = max(corners[box, 1] - y, 0.0, y - corners[box, 4])
                    w = max(corners[box, 2] - z, 0.0, z - corners[box, 5])
                    if u * u + v * v + w * w > reach * reach or scratch.box_stamp[box] == visit:
                        continue
                    scratch.box_stamp[box] = visit
                    # Skip boxes that lie apart from the box around the set, and the support.
                    if boxes_apart(bounds, s, corners, box, need) or (
                        len(boxes.tops) > 0 and _is_support(boxes, box, bounds[s, 2])
                    ):
                        continue
                    # Skip boxes whose nearest corner lies beyond the remembered plane.
                    if plane >= 0 and (
                        nx * corners[box, 0 if nx > 0.0 else 3]
                        + ny * corners[box, 1 if ny > 0.0 else 4]
                        + nz * corners[box, 2 if nz > 0.0 else 5]
                        >= offset
                    ):
                        continue
                    # The set itself against the box.
                    answer = _set_meets_box(arm, boxes, scratch, s, box, need, hit)
                    if answer == COLLIDING:
                        return COLLIDING
                    if answer == UNDECIDED:
                        # The distance cannot be kept any more: only collisions are looked for.
                        result = UNDECIDED
                        need = hit
                    elif scratch.work[5, 3] >= 0.0:
                        # What keeps this box away may keep its neighbours away.
                        plane = scratch.plane[s]
                        nx, ny, nz, offset = _plane_in_world(arm, scratch, s, plane, need)
    return result


@njit(cache=True, nogil=True, pipeline_class=Uncounted, inline="always")
def body_meets_boxes(
    arm: ArmArrays, boxes: BoxArrays, scratch: ArmScratch, body: int, need: float, hit: float
) -> int:
    """One moving body against the obstacle set: FREE from `need` on, COLLIDING below `hit`.

    What is left UNDECIDED is noted as `hit`.
    """
    # First the field, then the boxes in reach of what it leaves open.
    answer, count = open_leaves(arm, boxes, scratch, (body, body + 1, -1), need, hit)
    if answer == COLLIDING or count == 0:
        return answer
    if answer == UNDECIDED:
        need = hit
    found = open_leaves_meet_boxes(arm, boxes, scratch, count, need, hit)
    return found if found != FREE else answer
