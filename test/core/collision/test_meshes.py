"""Original triangles against coal's distances, brute force and what is known to be inside."""

import coal
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from placement_planner_ros.core.collision.against_mesh import (
    mesh_keeps_hull,
    meshes_keep,
    winding_number,
)
from placement_planner_ros.core.collision.meshes import MeshTree, mesh_arrays

WORK = np.zeros((9, 4))
ROOMS = np.zeros((4, 3)), np.zeros((64, 2), np.int64), WORK


def bvh(corners):
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(corners), 3 * len(corners))
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    points.extend(list(corners.reshape(-1, 3)))
    triangles.extend([coal.Triangle(3 * t, 3 * t + 1, 3 * t + 2) for t in range(len(corners))])
    model.addSubModel(points, triangles)
    model.endModel()
    return model


def solid(name):
    if name == "torus":
        return trimesh.creation.torus(0.1, 0.03, 24, 12)
    if name == "annulus":
        return trimesh.creation.annulus(0.05, 0.08, 0.2, sections=20)
    if name == "two balls":
        balls = [trimesh.creation.icosphere(2, 0.05) for _ in range(2)]
        balls[1].apply_translation((0.07, 0.0, 0.0))
        return trimesh.util.concatenate(balls)
    return trimesh.creation.box((0.2, 0.1, 0.05))


SOLIDS = ("torus", "annulus", "two balls", "box")


def arrays_of(*meshes):
    return mesh_arrays([MeshTree.of(np.asarray(m.vertices), np.asarray(m.faces)) for m in meshes])


def random_pose(rng, reach):
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    T[:3, 3] = rng.uniform(-reach, reach, 3)
    return T


def coal_distance(a, b, T):
    return coal.distance(
        a,
        coal.Transform3s(),
        b,
        coal.Transform3s(T[:3, :3], T[:3, 3]),
        coal.DistanceRequest(),
        coal.DistanceResult(),
    )


def surrounded(mesh, points):
    """(n,) whether the triangles go once around each point (n, 3), by their solid angles."""
    a, b, c = np.moveaxis(mesh.triangles - points[:, None, None], 2, 0)
    la, lb, lc = (np.linalg.norm(each, axis=-1) for each in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=-1)
    dots = [(u * v).sum(axis=-1) * w for u, v, w in ((a, b, lc), (b, c, la), (c, a, lb))]
    angles = 2.0 * np.arctan2(volume, la * lb * lc + sum(dots)).sum(axis=1)
    return np.abs(angles) > 2.0 * np.pi


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("turned", [False, True])
def test_inside_is_where_the_solid_is(name, turned):
    mesh = solid(name)
    if turned:
        mesh.invert()
    arrays = arrays_of(mesh)
    rng = np.random.default_rng(1)
    points = rng.uniform(mesh.bounds[0] - 0.02, mesh.bounds[1] + 0.02, (1500, 3))
    inside = surrounded(mesh, points)
    assert 50 < inside.sum() < 1450
    assert [winding_number(arrays, 0, *p) > 0 for p in points] == inside.tolist()


def test_sheets_have_no_inside_and_what_encloses_no_hollow():
    sphere = trimesh.creation.icosphere(2, 0.1)
    opened = trimesh.Trimesh(sphere.vertices, sphere.faces[1:], process=False)
    assert winding_number(arrays_of(opened), 0, 0.0, 0.0, 0.0) == 0
    inner = trimesh.creation.icosphere(2, 0.05)
    inner.invert()
    shell = trimesh.util.concatenate([sphere, inner])
    assert winding_number(arrays_of(shell), 0, 0.07, 0.0, 0.0) > 0
    assert winding_number(arrays_of(shell), 0, 0.0, 0.0, 0.0) > 0, "nothing gets there"


@pytest.mark.parametrize("name", SOLIDS)
def test_a_hull_is_free_and_collides_as_coal_says(name):
    mesh = solid(name)
    arrays, surface = arrays_of(mesh), bvh(np.asarray(mesh.triangles))
    rng = np.random.default_rng(3)
    half = np.array([0.03, 0.02, 0.01])
    block = coal.Box(*(2 * half))
    corners = np.array(np.meshgrid(*([-1, 1],) * 3)).reshape(3, -1).T * half
    answers = []
    for _ in range(400):
        T = random_pose(rng, 0.2)
        points = corners @ T[:3, :3].T + T[:3, 3]
        distance = coal_distance(surface, block, T)
        if distance > 0.0 and surrounded(mesh, T[None, :3, 3])[0]:
            distance = -1.0
        for need in (0.02, 0.003):
            answer = mesh_keeps_hull(arrays, 0, points, 8, need, WORK)
            answers.append(answer)
            if abs(distance - need) > 1e-4:
                assert answer == (distance > need), (distance, answer)
    assert 0.2 < np.mean(answers) < 0.98


@pytest.mark.parametrize(("first", "second"), [("torus", "annulus"), ("box", "two balls")])
def test_two_meshes_are_free_and_collide_as_coal_says(first, second):
    a, b = solid(first), solid(second)
    arrays = arrays_of(a, b)
    surfaces = bvh(np.asarray(a.triangles)), bvh(np.asarray(b.triangles))
    rng = np.random.default_rng(4)
    answers = []
    for _ in range(400):
        T = random_pose(rng, 0.2)
        distance = coal_distance(*surfaces, T)
        need = 0.005
        answer = meshes_keep(arrays, (0, 1), T[None], need, ROOMS)
        answers.append(answer)
        if abs(distance - need) > 1e-4:
            assert answer == (distance > need), (distance, answer)
    assert 0.1 < np.mean(answers) < 0.98


@pytest.mark.parametrize("gap", [0.0005, 0.002])
def test_surfaces_that_run_beside_each_other_are_free_as_far_as_they_are_apart(gap):
    """A shaft in its bearing, wherever it is turned to."""
    shaft = trimesh.creation.cylinder(0.03, 0.1, sections=90)
    bearing = trimesh.creation.annulus(0.03 + gap, 0.05, 0.04, sections=90)
    arrays = arrays_of(bearing, shaft)
    surfaces = bvh(np.asarray(bearing.triangles)), bvh(np.asarray(shaft.triangles))
    rng = np.random.default_rng(5)
    for _ in range(20):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("z", rng.uniform(-3.0, 3.0)).as_matrix()
        T[:3, 3] = rng.uniform(-0.3, 0.3, 3) * gap
        distance = coal_distance(*surfaces, T)
        assert 0.0 < distance < gap
        for order, T_order in (((0, 1), T), ((1, 0), np.linalg.inv(T))):
            for share, kept in ((0.98, True), (1.02, False)):
                answer = meshes_keep(arrays, order, T_order[None], share * distance, ROOMS)
                assert answer == kept


def test_what_lies_wholly_inside_collides_whichever_of_both_it_is():
    large, small = trimesh.creation.icosphere(2, 0.2), trimesh.creation.box((0.02, 0.02, 0.02))
    # One of several components, and not the first.
    far = trimesh.creation.box((0.02, 0.02, 0.02))
    far.apply_translation((0.5, 0.0, 0.0))
    several = trimesh.util.concatenate([far, small])
    arrays = arrays_of(large, several)
    for order in ((0, 1), (1, 0)):
        assert not meshes_keep(arrays, order, np.eye(4)[None], 0.0, ROOMS)
    T = np.eye(4)
    T[1, 3] = 0.5
    assert meshes_keep(arrays, (0, 1), T[None], 0.0, ROOMS)
    corners = np.asarray(small.vertices)
    assert not mesh_keeps_hull(arrays, 0, corners, 8, 0.0, WORK)
