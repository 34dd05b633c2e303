"""The points that stand for what is known exactly."""

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from scipy.spatial import cKDTree

from placement_planner_ros.ros.inputs.known_surface import SPACING_M, surface_points

ROD = trimesh.creation.cylinder(radius=0.001, height=1.5, sections=64)


@pytest.mark.parametrize(
    ("mesh", "most"),
    [
        (trimesh.creation.box((2.0, 2.0, 0.5)), 3_000_000),
        (trimesh.creation.icosphere(subdivisions=4, radius=0.05), 12_000),
        (ROD, 200_000),
    ],
    ids=["large", "fine", "rod"],
)
def test_no_place_on_its_surface_is_far_from_all_points_and_they_are_not_too_many(mesh, most):
    T = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 1.0), np.array([0.5, 0.1, -0.4]))
    points = surface_points(mesh.triangles @ T.rotation.T + T.translation)
    assert len(points) < most
    surface, _ = trimesh.sample.sample_surface(mesh, 5000, seed=1)
    far, _ = cKDTree(points).query(surface @ T.rotation.T + T.translation)
    assert far.max() < 0.7 * SPACING_M
    corners = mesh.vertices @ T.rotation.T + T.translation
    np.testing.assert_allclose(points.min(axis=0), corners.min(axis=0), atol=2e-5)
    np.testing.assert_allclose(points.max(axis=0), corners.max(axis=0), atol=2e-5)
