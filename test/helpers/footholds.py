"""Racks, bridges, pedestals and posts: their clouds, their solids, and what stands on them by plain
geometry."""

from dataclasses import dataclass
from itertools import product
from types import SimpleNamespace

import numpy as np
from checker.carried import clipped
from scipy.spatial import ConvexHull

from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.types import TargetVolume, upright

VOLUME = TargetVolume([0.2, -0.3, -0.06], [0.8, 0.3, 0.3])
PIVOT = np.array([0.5, 0.0, 0.0])
"""About which scenes are tilted."""


@dataclass(frozen=True)
class Block:
    """An upright box whose top is at height z, before it is tilted."""

    name: str
    x: tuple[float, float]
    y: tuple[float, float]
    z: float = 0.0
    depth: float = 0.02

    @property
    def vertices(self):
        choice = np.array(np.meshgrid(*[(0, 1)] * 3)).reshape(3, -1)
        sides = np.array([self.x, self.y, (self.z - self.depth, self.z)])
        return np.column_stack([sides[k][choice[k]] for k in range(3)])

    def points(self, spacing=0.004):
        """(n, 3) of top and sides."""
        x, y = (np.append(np.arange(*side, spacing), side[1]) for side in (self.x, self.y))
        z = np.arange(self.z - self.depth, self.z, spacing)
        planes = [_mesh(x, y, [self.z]), *(_mesh([a], y, z) for a in self.x)]
        return np.vstack(planes + [_mesh(x, [b], z) for b in self.y])


def _mesh(x, y, z):
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), -1).reshape(-1, 3)


def rack(width, pitch, bars=7, **block):
    """Bars along y."""
    begin = 0.5 - 0.5 * (bars - 1) * pitch - 0.5 * width
    sides = begin + pitch * np.arange(bars)
    return [Block(f"bar {k}", (a, a + width), (-0.3, 0.3), **block) for k, a in enumerate(sides)]


def pedestal(size, x=0.5, y=0.0, depth=0.2, name="pedestal", **block):
    half = 0.5 * size
    return Block(name, (x - half, x + half), (y - half, y + half), depth=depth, **block)


def turned(points, slope):
    return (points - PIVOT) @ upright(slope).T + PIVOT


def cloud(blocks, slope=(0.0, 0.0), spacing=0.004):
    """(n, 3) of blocks and of a floor below them."""
    floor = _mesh(np.arange(0.0, 1.0, 0.006), np.arange(-0.5, 0.5, 0.006), [-0.2])
    return np.vstack([floor, turned(np.vstack([b.points(spacing) for b in blocks]), slope)])


def problem_on(body, blocks, slope=(0.0, 0.0), volume=VOLUME, spacing=0.004, noise=0.0):
    """`bare_problem` on the cloud of blocks that are tilted together."""
    points = cloud(blocks, slope, spacing)
    if noise:
        points = points + np.random.default_rng(5).normal(0.0, noise, points.shape)
    bounds = volume.lower - 0.4, volume.upper + 0.4
    environment = Environment.from_points(
        points, volume, regions=RegionSettings(max_slope=0.26), bounds=bounds
    )
    return bare_problem(body, environment)


def bare_problem(body, environment=None):
    """A problem that no robot is part of."""
    arm = SimpleNamespace(grasps=(None,))
    volume = VOLUME if environment is None else environment.volume
    return Problem(None, (arm,), np.zeros(1), body, volume, environment)


def carried_corners(patches, blocks):
    """(n, 2) corners of what carries convex polygons (k, 2) of the object that touch."""
    tops = [np.array(list(product(b.x, b.y)))[[0, 2, 3, 1]] for b in blocks]
    return np.vstack([clipped(patch, top) for patch in patches for top in tops])


def spare(patches, blocks, foot, height):
    """How far within the hull of what carries it a foot (2,) is, m, and by which angle an object
    could be tipped whose centre of mass is so high; on level ground at z = 0."""
    carried = carried_corners(patches, blocks)
    if len(carried) < 3 or np.linalg.matrix_rank(carried - carried[0], tol=1e-6) < 2:
        return -np.inf, -np.inf
    inside = -(ConvexHull(carried).equations @ np.append(foot, 1.0)).max()
    return inside, np.arctan2(inside, height)
