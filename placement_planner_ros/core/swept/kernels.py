"""Compiled parts of `space`: what is swept when, and which points that meets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.collision.against_mesh import mesh_meets_hull
from placement_planner_ros.core.collision.arrays import (
    BODY_FIRST_SET,
    BODY_JOINT,
    MESH_TREE,
    NODE_SET,
    NODE_SKIP,
    SET_FIRST_NODE,
    SET_FIRST_PLANE,
    SET_FIRST_VERTEX,
    SET_MESH,
    ArmArrays,
    Indices,
)
from placement_planner_ros.core.collision.separation import FREE, check_separation
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.reach.kinematics import chain_frames, to_world
from placement_planner_ros.core.scene.obstacle_arrays import ObstacleArrays
from placement_planner_ros.core.types import Array

Marks = npt.NDArray[np.int32]
Point = tuple[float, float, float]
Work = tuple[Array, Array]
"""(6, 4) for `check_separation`, and (1, 3) for a point."""

BLOCK_CONFIGURATIONS = 9
"""Configurations that share a mark; odd, so that one is in their middle."""
_COARSE_RADIUS_M = 0.05
"""m, radius of spheres below which the cubes they sweep are not looked at more closely."""


class SweptPath(NamedTuple):
    """A stretch for the kernels."""

    arm: ArmArrays
    frames: Array
    """(k, n + 2, 4, 4) of every configuration."""
    slack: float
    """m, half of how far a point of a body moves between two configurations."""
    contact: float
    slope_x: float
    slope_y: float
    first: int
    """The first mark of this stretch."""


class SweptCubes(NamedTuple):
    """Where something is swept."""

    origin: Array
    size: float
    begin: Marks
    """(nx, ny, nz) the first mark at which something sweeps a cube, and ..."""
    end: Marks
    """... the last one and one; 0 where nothing ever does."""


@kernel(nogil=True)
def place_all(arm: ArmArrays, configurations: Array, frames: Array) -> None:
    for k in range(len(configurations)):
        # Frames of all joints and the tip, one configuration after the other.
        chain_frames(arm.fixed, arm.prismatic, configurations[k], frames[k])


@kernel(nogil=True)
def largest_motions(arm: ArmArrays, frames: Array) -> Array:
    """(k - 1,) how far points of bodies move at most from each of (k, n + 2, 4, 4) to the next.

    A point of the ball around a body moves no further than its centre, and the radius times the
    change of the rotation matrix (its Frobenius norm).
    """
    moved = np.zeros(max(len(frames) - 1, 0))
    for k in range(len(moved)):
        # From one configuration to the next, the ball around each body at both.
        a, b = frames[k], frames[k + 1]
        for body in range(arm.moving):
            joint, ball = arm.bodies[body, BODY_JOINT], arm.body_spheres[body]
            x, y, z = to_world(a, joint, ball[0], ball[1], ball[2])
            u, v, w = to_world(b, joint, ball[0], ball[1], ball[2])
            # The Frobenius norm of the change of the rotation matrix, squared.
            turned = 0.0
            for i in range(3):
                for j in range(3):
                    turned += (b[joint, i, j] - a[joint, i, j]) ** 2
            # A turn by one angle has two equal singular values.
            far = np.sqrt((u - x) ** 2 + (v - y) ** 2 + (w - z) ** 2)
            moved[k] = max(moved[k], far + ball[3] * np.sqrt(0.5 * turned))
    return moved


@kernel(nogil=True)
def extend_corners(path: SweptPath, beyond: float, lower: Array, upper: Array) -> None:
    """Move the corners out until they hold all that is swept, and what is so far beyond."""
    arm, frames = path.arm, path.frames
    # The ball around each body at every configuration.
    for k in range(len(frames)):
        for body in range(arm.moving):
            ball = arm.body_spheres[body]
            place = to_world(frames[k], arm.bodies[body, BODY_JOINT], ball[0], ball[1], ball[2])
            # The box around it, and what is so far beyond.
            for i in range(3):
                lower[i] = min(lower[i], place[i] - ball[3] - beyond)
                upper[i] = max(upper[i], place[i] + ball[3] + beyond)


@kernel(nogil=True)
def mark_cubes(path: SweptPath, beyond: float, cubes: SweptCubes) -> None:
    """Note when cubes are swept: those whose centre is near enough to a sphere around a piece of a
    body at the middle of a block of configurations."""
    arm, frames, size, origin = path.arm, path.frames, cubes.size, cubes.origin
    # Half a cube's diagonal, so that a cube counts where its centre is near enough.
    nodes, spheres = arm.nodes, arm.node_spheres
    nx, ny, nz = cubes.end.shape
    beyond += 0.8661 * size
    blocks = (len(frames) + BLOCK_CONFIGURATIONS - 1) // BLOCK_CONFIGURATIONS
    # The middle of the block stands for all of its configurations.
    for block in range(blocks):
        mark = path.first + block
        k = min(block * BLOCK_CONFIGURATIONS + BLOCK_CONFIGURATIONS // 2, len(frames) - 1)
        # The tree of spheres around the pieces of each body.
        for body in range(arm.moving):
            joint = arm.bodies[body, BODY_JOINT]
            node = arm.sets[arm.bodies[body, BODY_FIRST_SET], SET_FIRST_NODE]
            last = arm.sets[arm.bodies[body + 1, BODY_FIRST_SET], SET_FIRST_NODE]
            while node < last:
                # A large sphere that is not a leaf: look at those below it.
                if spheres[node, 3] > _COARSE_RADIUS_M and nodes[node, NODE_SET] < 0:
                    node += 1
                    continue
                # The sphere's centre from the corner of the cubes, and its reach; what is below it
                # is covered.
                x, y, z = to_world(
                    frames[k], joint, spheres[node, 0], spheres[node, 1], spheres[node, 2]
                )
                x, y, z = x - origin[0], y - origin[1], z - origin[2]
                far = spheres[node, 3] + beyond
                node = nodes[node, NODE_SKIP]
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
                        high = np.sqrt(rest)
                        # The row's cubes along z: note when they are first and last swept.
                        for h in range(
                            max(int((z - high) / size), 0), min(int((z + high) / size) + 1, nz)
                        ):
                            if cubes.end[i, j, h] == 0:
                                cubes.begin[i, j, h] = mark
                            cubes.end[i, j, h] = mark + 1


@kernel(nogil=True)
def find_news(
    points: Array,
    cubes: SweptCubes,
    known: ObstacleArrays,
    within: float,
    rows: Indices,
) -> int:
    """Fill `rows` with the points that are in a swept cube and far from every box; how many."""
    # Cubes that are swept, and the boxes of the known obstacles by their cells.
    origin, end = cubes.origin, cubes.end
    nx, ny, nz = end.shape
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
        if end[int(fx), int(fy), int(fz)] == 0:
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


@kernel(lean=True)
def _near_set(path: SweptPath, s: int, at: Point, need: float, work: Work) -> bool:
    """Whether a point in its joint's frame is nearer than `need` to set s, or it is not certain."""
    x, y, z = at
    arm = path.arm
    sets, planes = arm.sets, arm.planes
    reach = need + arm.radius[s]
    # How far the point lies beyond the planes of the set.
    deepest = -np.inf
    for p in range(sets[s, SET_FIRST_PLANE], sets[s + 1, SET_FIRST_PLANE]):
        deepest = max(
            deepest, planes[p, 0] * x + planes[p, 1] * y + planes[p, 2] * z - planes[p, 3]
        )
        if deepest >= reach:
            return False
    # Below all planes it is inside.
    if -np.inf < deepest <= arm.radius[s]:
        return True
    # The distance, sought from a corner of the set on.
    room, point = work
    point[0, 0], point[0, 1], point[0, 2] = x, y, z
    first = sets[s, SET_FIRST_VERTEX]
    room[5, 0] = arm.vertices[first, 0] - x
    room[5, 1] = arm.vertices[first, 1] - y
    room[5, 2] = arm.vertices[first, 2] - z
    answer = check_separation(
        arm.vertices, first, sets[s + 1, SET_FIRST_VERTEX], point, 0, 1, reach, reach, room
    )
    return answer != FREE


@kernel(lean=True)
def _near_mesh(path: SweptPath, mesh: int, at: Point, need: float, work: Work) -> bool:
    """The same for a mesh."""
    # The point in the frame of the mesh.
    arm = path.arm
    T = arm.mesh_frames[mesh]
    room, point = work
    dx, dy, dz = at[0] - T[0, 3], at[1] - T[1, 3], at[2] - T[2, 3]
    for i in range(3):
        point[0, i] = T[0, i] * dx + T[1, i] * dy + T[2, i] * dz
    # As a hull of one point.
    answer = mesh_meets_hull(arm.trees, arm.meshes[mesh, MESH_TREE], point, 1, need, need, room)
    return answer != FREE


@kernel(lean=True)
def _near_body(path: SweptPath, k: int, body: int, at: Point, need: float, work: Work) -> bool:
    """Whether a point is nearer than `need` to a body at configuration k, or it is not certain."""
    arm = path.arm
    joint = arm.bodies[body, BODY_JOINT]
    F = path.frames[k, joint]
    dx, dy, dz = at[0] - F[0, 3], at[1] - F[1, 3], at[2] - F[2, 3]
    # The point in the joint's frame, in which the body does not move.
    x = F[0, 0] * dx + F[1, 0] * dy + F[2, 0] * dz
    y = F[0, 1] * dx + F[1, 1] * dy + F[2, 1] * dz
    z = F[0, 2] * dx + F[1, 2] * dy + F[2, 2] * dz
    nodes, spheres, sets = arm.nodes, arm.node_spheres, arm.sets
    # Down the tree of spheres.
    node = arm.sets[arm.bodies[body, BODY_FIRST_SET], SET_FIRST_NODE]
    last = arm.sets[arm.bodies[body + 1, BODY_FIRST_SET], SET_FIRST_NODE]
    while node < last:
        # Too far from the sphere: skip all that is below it.
        far = spheres[node, 3] + need
        u, v, w = x - spheres[node, 0], y - spheres[node, 1], z - spheres[node, 2]
        if u * u + v * v + w * w > far * far:
            node = nodes[node, NODE_SKIP]
            continue
        # A leaf: its convex set, and where that is a cover the mesh.
        s = nodes[node, NODE_SET]
        if s >= 0 and _near_set(path, s, (x, y, z), need, work):
            mesh = sets[s, SET_MESH]
            if mesh < 0 or _near_mesh(path, mesh, (x, y, z), need, work):
                return True
        node += 1
    return False


@kernel(lean=True)
def _body_at(path: SweptPath, cubes: SweptCubes, at: Point, margin: float, work: Work) -> int:
    """The first body that a point is nearer to than the margin anywhere on a stretch, or -1."""
    # The cube of the point; outside of all cubes nothing sweeps it.
    x, y, z = at
    arm, frames = path.arm, path.frames
    nx, ny, nz = cubes.end.shape
    i = int(np.floor((x - cubes.origin[0]) / cubes.size))
    j = int(np.floor((y - cubes.origin[1]) / cubes.size))
    h = int(np.floor((z - cubes.origin[2]) / cubes.size))
    if not (0 <= i < nx and 0 <= j < ny and 0 <= h < nz):
        return -1
    # Height of the point above the contact plane.
    above = z - path.slope_x * x - path.slope_y * y - path.contact
    # The blocks during which the cube is swept.
    blocks = (frames.shape[0] + BLOCK_CONFIGURATIONS - 1) // BLOCK_CONFIGURATIONS
    begin = max(cubes.begin[i, j, h] - path.first, 0)
    end = min(cubes.end[i, j, h] - path.first, blocks)
    # What is to be kept at one configuration, and at the middle of a block.
    need = margin + path.slack
    coarse = margin + path.slack * BLOCK_CONFIGURATIONS
    for block in range(begin, end):
        # The block's configurations, and the one in their middle.
        first = block * BLOCK_CONFIGURATIONS
        last = min(first + BLOCK_CONFIGURATIONS, frames.shape[0])
        middle = min(first + BLOCK_CONFIGURATIONS // 2, frames.shape[0] - 1)
        for body in range(arm.moving):
            # The held object may touch what lies below its contact plane.
            if body == arm.held and above <= 0.0:
                continue
            # The ball around the body at the middle of the block.
            ball, joint = arm.body_spheres[body], arm.bodies[body, BODY_JOINT]
            u, v, w = to_world(frames[middle], joint, ball[0], ball[1], ball[2])
            far = ball[3] + coarse
            if (u - x) ** 2 + (v - y) ** 2 + (w - z) ** 2 > far * far:
                continue
            # Each configuration of the block.
            for k in range(first, last):
                if _near_body(path, k, body, at, need, work):
                    return body
    return -1


@kernel(lean=True, nogil=True)
def find_hit(
    points: Array,
    cubes: SweptCubes,
    path: SweptPath,
    margin: float,
    together: float,
    fewest: int,
    work: Work,
) -> tuple[int, int]:
    """The first point that a body comes too near to, of `fewest` that lie together, and the body;
    or -1."""
    count = points.shape[0]
    for row in range(count):
        # The body that comes too near to the point, if one does.
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        body = _body_at(path, cubes, (x, y, z), margin, work)
        if body < 0:
            continue
        # Count the points around it, itself among them, until they are enough.
        company = 0
        for other in range(count):
            company += (
                abs(points[other, 0] - x) <= together
                and abs(points[other, 1] - y) <= together
                and abs(points[other, 2] - z) <= together
            )
            if company >= fewest:
                return row, body
    return -1, -1
