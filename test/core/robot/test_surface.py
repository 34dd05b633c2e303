"""A surface in pieces answers as coal does of all its triangles at once."""

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from placement_planner_ros.core.collision.meshes import tree_order
from placement_planner_ros.core.robot.geometry import triangle_geometry
from placement_planner_ros.core.robot.surface import Surface, contact, meet, nearest

PIECE = 64
OTHERS = {
    "box": coal.Box(0.05, 0.02, 0.03),
    "ball": coal.Sphere(0.02),
    "rod": coal.Cylinder(0.004, 0.2),
}


@pytest.fixture(scope="module")
def both():
    """A ring as a surface in pieces, and as one tree of coal."""
    ring = trimesh.creation.torus(0.1, 0.03, major_sections=48, minor_sections=24)
    corners = np.asarray(ring.triangles)
    order, first = tree_order(corners.mean(axis=1), PIECE)
    return Surface(corners[order], first, [ring.vertices]), triangle_geometry(
        ring.vertices, ring.faces
    )


def places(number):
    rng = np.random.default_rng(0)
    for _ in range(number):
        T = pin.SE3(pin.Quaternion(*rng.normal(size=4)).normalized().matrix(), rng.normal(size=3))
        yield coal.Transform3s(T.rotation, T.translation * [0.1, 0.1, 0.03])


@pytest.mark.parametrize("name", OTHERS)
def test_it_meets_and_is_as_far_from_others_as_its_triangles(both, name):
    surface, whole = both
    other, answers = OTHERS[name], []
    for T, at in zip(places(60), list(places(120))[60:], strict=True):
        for margin in (0.0, 0.01):
            answers.append(meet(whole, T, other, at, margin))
            assert meet(surface, T, other, at, margin) == answers[-1]
            assert meet(other, at, surface, T, margin) == answers[-1]
        far = nearest(whole, T, other, at)
        if far.min_distance > 0.0:
            for found in (nearest(surface, T, other, at), nearest(other, at, surface, T)):
                assert found.min_distance == pytest.approx(far.min_distance, abs=1e-7)
            apart = found.getNearestPoint1() - found.getNearestPoint2()
            assert np.linalg.norm(apart) == pytest.approx(far.min_distance, abs=1e-7)
        assert (contact(surface, T, other, at) is None) == (not meet(whole, T, other, at))
    assert 0.1 < np.mean(answers) < 0.9


def test_the_ball_around_it_is_that_of_its_triangles(both):
    surface, whole = both
    assert surface.aabb_center == pytest.approx(whole.aabb_center, abs=1e-9)
    assert surface.aabb_radius == pytest.approx(whole.aabb_radius, abs=1e-9)
    assert surface.aabb_local.min_ == pytest.approx(whole.aabb_local.min_, abs=1e-9)


def test_only_what_something_comes_near_is_laid_out(both, monkeypatch):
    made = []
    name = "placement_planner_ros.core.robot.surface.triangle_geometry"
    monkeypatch.setattr(name, lambda *of: (made.append(1), triangle_geometry(*of))[1])
    surface = Surface(both[0].corners, both[0]._first, both[0].connected)
    far, near = (coal.Transform3s(np.eye(3), np.array([x, 0.0, 0.0])) for x in (1.0, 0.13))
    still = coal.Transform3s.Identity()
    assert not meet(surface, still, OTHERS["ball"], far)
    assert not made
    assert meet(surface, still, OTHERS["ball"], near)
    assert 1 <= len(made) <= 3 < len(both[0]._first) - 1
    meet(surface, still, OTHERS["ball"], near)
    nearest(surface, still, OTHERS["ball"], far)
    assert len(made) <= 4
