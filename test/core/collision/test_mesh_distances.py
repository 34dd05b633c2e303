import numpy as np
import pytest
import trimesh

from placement_planner_ros.core.collision.mesh_distances import SolidSurface

RING = trimesh.creation.torus(0.3, 0.1)
BOX = trimesh.creation.box((0.2, 0.3, 0.4))


@pytest.mark.parametrize("mesh", [RING, BOX], ids=["ring", "box"])
def test_distances_are_those_of_all_triangles(mesh):
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (100, 3))
    found, nearest = SolidSurface.of(mesh.triangles).distances(points, 2.0)
    for point, distance, spot in zip(points, found, nearest, strict=True):
        every = trimesh.triangles.closest_point(
            mesh.triangles, np.repeat(point[None], len(mesh.triangles), 0)
        )
        least = np.linalg.norm(every - point, axis=1).min()
        assert abs(distance) == pytest.approx(least, abs=1e-9)
        assert np.linalg.norm(point - spot) == pytest.approx(least, abs=1e-9)


def test_only_what_is_enclosed_is_inside():
    points = np.random.default_rng(1).uniform(-0.45, 0.45, (5000, 3))
    depth = 0.1 - np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.3, points[:, 2])
    sure = np.abs(depth) > 0.003  # the mesh is not quite round
    found, _ = SolidSurface.of(RING.triangles).distances(points, 0.01)
    assert np.array_equal(found[sure] < 0.0, depth[sure] > 0.0)
    assert (np.isinf(found) == (np.abs(found) > 0.01)).all()
    sheet, _ = SolidSurface.of(RING.triangles[1:]).distances(points, 0.01)
    assert (sheet > 0.0).all()


def test_points_and_lines_have_a_radius():
    line = np.array([[[0.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]]])
    points = np.array([[0.5, 0.3, 0.0], [1.2, 0.0, 0.0], [0.5, 0.05, 0.0], [3.0, 0.0, 0.0]])
    found, nearest = SolidSurface.of(line, 0.1).distances(points, 1.0)
    assert found == pytest.approx([0.2, 0.1, -0.05, np.inf])
    on_it = [[0.5, 0.1, 0.0], [1.1, 0.0, 0.0], [0.5, 0.1, 0.0]]
    assert nearest[:3].ravel() == pytest.approx(np.ravel(on_it))
    assert np.isnan(nearest[3]).all()


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_the_nearest_point_of_what_is_round_is_on_its_surface(radius):
    """Outside and inside, of the triangles too."""
    points = np.random.default_rng(2).uniform(-0.3, 0.3, (500, 3))
    surface = SolidSurface.of(BOX.triangles, radius)
    found, nearest = surface.distances(points, 1.0)
    assert np.abs(found) == pytest.approx(np.linalg.norm(points - nearest, axis=1))
    assert np.abs(surface.distances(nearest, 1.0)[0]).max() < 1e-9
