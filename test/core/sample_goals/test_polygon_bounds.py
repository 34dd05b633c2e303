"""Support by polygon: no pose that stands is in a cell that is ruled out."""

import functools

import numpy as np
import pytest
import trimesh
from helpers.cells import cells_across, some_pose_stands, unsupported_by
from helpers.footholds import Block, pedestal, problem_on, rack

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.types import LEVEL
from placement_planner_ros.scenes.objects import object_by_name


def random_blocks(kind, rng):
    """A scene of that kind, of sizes drawn anew."""
    if kind == "rack":
        width = rng.uniform(0.02, 0.06)
        return rack(width, width + rng.uniform(0.05, 0.09), 6)
    if kind == "bridge":
        half, y = rng.uniform(0.02, 0.05), rng.uniform(-0.1, 0.1)
        return [Block("bridge", (0.15, 0.85), (y - half, y + half))]
    if kind == "pedestals":
        at = rng.uniform([0.3, -0.2], [0.7, 0.2], (4, 2))
        sizes = rng.uniform(0.03, 0.09, 4)
        heights = (0.0, 0.0, 0.05, 0.001)
        return [
            pedestal(size, *xy, z=z, name=str(k))
            for k, (size, xy, z) in enumerate(zip(sizes, at, heights, strict=True))
        ]
    # two tables apart, the gap under V
    gap = rng.uniform(0.03, 0.1)
    sides = (-0.4, -gap), (gap, 0.4)
    return [Block(str(k), (0.1, 0.9), side) for k, side in enumerate(sides)]


def body(name):
    if name == "box":
        mesh = trimesh.creation.box((0.18, 0.12, 0.05))
        return Body.from_mesh(mesh.vertices, mesh.faces, (0.04, 0.02, 0.0))
    if name == "tall box":
        mesh = trimesh.creation.box((0.12, 0.12, 0.24))
        return Body.from_mesh(mesh.vertices, mesh.faces)
    held = object_by_name(name)
    return Body.from_mesh(held.vertices, held.triangles, held.center_of_mass)


CASES = [
    ("rack", "box", LEVEL),
    ("bridge", "wine_glass", LEVEL),
    ("bridge", "box", (0.03, 0.06)),
    ("bridge", "tall box", (0.02, 0.2)),
    ("pedestals", "box", LEVEL),
    ("tables", "box", (0.1, -0.05)),
]


@functools.cache
def made(kind, name, slope):
    rng = np.random.default_rng(len(kind))
    problem = problem_on(body(name), random_blocks(kind, rng), slope)
    settings = PlannerSettings(support="polygon")
    poses = PoseConstraints(problem, settings.collision, settings.footing, 0.0)
    assert poses.contacts.regions
    if slope != LEVEL:
        assert {region.slope for region in poses.contacts.regions} != {LEVEL}
    return poses


@pytest.mark.parametrize(("kind", "name", "slope"), CASES, ids=str)
def test_no_cell_with_a_pose_that_stands_is_ruled_out(kind, name, slope):
    poses = made(kind, name, slope)
    regions, faces = poses.contacts.regions, len(poses.problem.body.faces)
    rng = np.random.default_rng(4)
    sets, cells = cells_across(regions, faces, rng, 300, [0.0, 0.005, 0.03, 0.15])
    unsupported = unsupported_by(poses, sets, cells)
    stable = some_pose_stands(poses, sets, cells)
    assert not (stable & unsupported).any()
    assert stable.sum() > 20
    assert unsupported.sum() > 10
