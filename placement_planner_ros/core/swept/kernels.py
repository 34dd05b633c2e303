"""Compiled parts of `space`: where something is swept, and which points are news there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from placement_planner_ros.core.collision import arrays as at
from placement_planner_ros.core.collision.arrays import ArmArrays
from placement_planner_ros.core.reach.kinematics import to_world
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.types import Array, Index, Mask


class SweptCubes(NamedTuple):
    """Where something is swept."""

    origin: Array
    size: float
    swept: Mask
    """(nx, ny, nz)."""


@njit(cache=True, nogil=True)
def mark_cubes(arm: ArmArrays, frames: Array, beyond: float, cubes: SweptCubes) -> None:
    """Mark cubes that come so near, metres, to a sphere around a piece of a body at any of frames
    (k, n + 2, 4, 4)."""
    size, origin, swept = cubes.size, cubes.origin, cubes.swept
    nodes, spheres = arm.nodes, arm.node_spheres
    nx, ny, nz = swept.shape
    # Half a cube's diagonal more, so that a cube counts where its centre is near enough.
    beyond += 0.8661 * size
    for k in range(len(frames)):
        # The tree of spheres around the pieces of each body.
        for body in range(arm.moving):
            joint = arm.bodies[body, at.BODY_JOINT]
            node = arm.sets[arm.bodies[body, at.BODY_FIRST_SET], at.SET_FIRST_NODE]
            last = arm.sets[arm.bodies[body + 1, at.BODY_FIRST_SET], at.SET_FIRST_NODE]
            while node < last:
                # A sphere wider than a few cubes that is not a leaf: look at those below it.
                if spheres[node, 3] > 2.0 * size and nodes[node, at.NODE_SET] < 0:
                    node += 1
                    continue
                # The sphere's centre from the corner of the cubes, and its reach; what is below it
                # is covered.
                x, y, z = to_world(
                    frames[k], joint, spheres[node, 0], spheres[node, 1], spheres[node, 2]
                )
                x, y, z = x - origin[0], y - origin[1], z - origin[2]
                far = spheres[node, 3] + beyond
                node = nodes[node, at.NODE_SKIP]
                # Slabs of cubes along x that the ball reaches, and its square half width there.
                for i in range(max(int((x - far) / size), 0), min(int((x + far) / size) + 1, nx)):
                    dx = (i + 0.5) * size - x
                    across = far * far - dx * dx
                    if across < 0.0:
                        continue
                    wide = np.sqrt(across)
                    # Rows of cubes along y in the slab.
                    for j in range(
                        max(int((y - wide) / size), 0), min(int((y + wide) / size) + 1, ny)
                    ):
                        dy = (j + 0.5) * size - y
                        rest = across - dy * dy
                        if rest < 0.0:
                            continue
                        # The row's cubes along z.
                        high = np.sqrt(rest)
                        first = max(int((z - high) / size), 0)
                        swept[i, j, first : min(int((z + high) / size) + 1, nz)] = True


@njit(cache=True, nogil=True)
def find_news(
    points: Array, cubes: SweptCubes, known: ObstacleArrays, within: float, rows: Index
) -> int:
    """Fill `rows` with the points that are in a swept cube and far from every box; how many."""
    # Cubes that are swept, and the boxes of the known obstacles by their cells.
    origin, swept = cubes.origin, cubes.swept
    nx, ny, nz = swept.shape
    per_metre = 1.0 / cubes.size
    lower, upper, following, number_at = known.lower, known.upper, known.next, known.number_at
    mx, my, mz = number_at.shape
    cells = 1.0 / known.cell_size
    count = 0
    for row in range(len(points)):
        # The cube of the point, if it is one that is swept.
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        fx = (x - origin[0]) * per_metre
        fy = (y - origin[1]) * per_metre
        fz = (z - origin[2]) * per_metre
        if not (0.0 <= fx < nx and 0.0 <= fy < ny and 0.0 <= fz < nz):
            continue
        if not swept[int(fx), int(fy), int(fz)]:
            continue
        # Cells of known obstacles within reach of the point.
        gx, gy, gz = x - known.origin[0], y - known.origin[1], z - known.origin[2]
        new = True
        for i in range(
            max(int(np.floor((gx - within) * cells)), 0),
            min(int(np.floor((gx + within) * cells)) + 1, mx),
        ):
            for j in range(
                max(int(np.floor((gy - within) * cells)), 0),
                min(int(np.floor((gy + within) * cells)) + 1, my),
            ):
                for k in range(
                    max(int(np.floor((gz - within) * cells)), 0),
                    min(int(np.floor((gz + within) * cells)) + 1, mz),
                ):
                    # The cell's boxes: the point is not new where one of them is near.
                    box = number_at[i, j, k] - 1
                    while new and box >= 0:
                        dx = max(lower[box, 0] - x, 0.0, x - upper[box, 0])
                        dy = max(lower[box, 1] - y, 0.0, y - upper[box, 1])
                        dz = max(lower[box, 2] - z, 0.0, z - upper[box, 2])
                        new = dx * dx + dy * dy + dz * dz > within * within
                        box = following[box]
        if new:
            rows[count] = row
            count += 1
    return count
