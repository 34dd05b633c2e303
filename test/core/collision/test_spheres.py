"""Spheres contain what they cover; shapes are what coal makes of the same geometry."""

import coal
import numpy as np
import pytest
import trimesh

from placement_planner_ros.core.body.convex_cover import convex_cover
from placement_planner_ros.core.body.covered_mesh import CoveredMesh
from placement_planner_ros.core.collision.shapes import Shape, mesh_shape, shape_of
from placement_planner_ros.core.collision.spheres import shape_rows
from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.geometry import enclosing_prism

EXCESS = 0.01


def leaves_of(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Centres and radii of the leaves around all sets of a shape."""
    rows = shape_rows(shape, EXCESS)
    leaves = rows.node_spheres[rows.nodes[:, 1] >= 0]
    return leaves[:, :3], leaves[:, 3]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


SHAPES = {
    "box": (coal.Box(0.1, 0.3, 0.02), trimesh.creation.box((0.1, 0.3, 0.02))),
    "sphere": (coal.Sphere(0.07), trimesh.creation.icosphere(3, 0.07)),
    "capsule": (coal.Capsule(0.03, 0.2), trimesh.creation.capsule(0.2, 0.03)),
    "cylinder": (enclosing_prism(0.06, 0.25), trimesh.creation.cylinder(0.06, 0.25, 60)),
    "torus": (None, trimesh.creation.torus(0.1, 0.02)),
}


def shape(name):
    """Of a primitive, or of a mesh by its cover."""
    geometry, mesh = SHAPES[name]
    if geometry is not None:
        return shape_of(geometry, name)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    return mesh_shape(CoveredMesh(vertices, faces, convex_cover(vertices, faces)))


_pill = SHAPES["capsule"][1]
_pill.apply_translation(-_pill.bounds.mean(axis=0))


@pytest.mark.parametrize("name", SHAPES)
def test_surface_lies_in_every_level_of_the_cover(name):
    points = trimesh.sample.sample_surface(SHAPES[name][1], 4000, seed=1)[0]
    centers, radii = leaves_of(shape(name))
    distance = np.linalg.norm(points[:, None] - centers, axis=2) - radii
    assert distance.min(axis=1).max() <= 1e-9
    rows = shape_rows(shape(name), EXCESS)
    roots = rows.node_spheres[rows.sets[:, 0]]
    whole = [np.linalg.norm(points - root[:3], axis=1) - root[3] for root in roots]
    assert np.min(whole, axis=0).max() <= 1e-9


@pytest.mark.parametrize("name", ["box", "sphere", "capsule", "cylinder"])
def test_inside_of_a_solid_is_covered_too(name, rng):
    geometry, mesh = SHAPES[name]
    centers, radii = leaves_of(shape_of(geometry, name))
    points = rng.uniform(*mesh.bounds, size=(4000, 3))
    heights = np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles_center)
    points = points[(points @ mesh.face_normals.T <= heights).all(axis=1)]
    assert len(points) > 500
    distance = np.linalg.norm(points[:, None] - centers, axis=2) - radii
    assert distance.min(axis=1).max() <= 1e-9


INSIDE = {
    "cylinder": lambda p: np.maximum(np.hypot(p[:, 0], p[:, 1]) - 0.06, np.abs(p[:, 2]) - 0.125),
    "box": lambda p: (np.abs(p) - (0.05, 0.15, 0.01)).max(axis=1),
    "sphere": lambda p: np.linalg.norm(p, axis=1) - 0.07,
    "capsule": lambda p: np.linalg.norm(p - np.clip(p, (0, 0, -0.1), (0, 0, 0.1)), axis=1) - 0.03,
}


@pytest.mark.parametrize("name", sorted(INSIDE))
def test_inner_balls_lie_inside_of_the_polytope_or_the_mesh(name, rng):
    spheres = shape_rows(shape_of(SHAPES[name][0], name), EXCESS).node_spheres
    directions = rng.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    outside = [
        INSIDE[name](center + inner * directions).max()
        for center, inner in zip(spheres[:, :3], spheres[:, 4], strict=True)
        if inner >= 0.0
    ]
    # The prism reaches 0.5 % beyond a cylinder.
    assert max(outside) <= (0.00031 if name == "cylinder" else 0.0)
    deepest = {"box": 0.01, "sphere": 0.07, "capsule": 0.03, "cylinder": 0.06}
    assert spheres[:, 4].max() > 0.9 * deepest[name]


@pytest.mark.parametrize(
    "geometry",
    [coal.Box(0.1, 0.0, 0.1), coal.Sphere(0.0), coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)],
)
def test_unusable_geometry_is_refused_by_name(geometry):
    with pytest.raises(RobotError, match="link elbow"):
        shape_of(geometry, "link elbow")
