"""Clouds of the bundled scenes: complete ones and those of cameras."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.clouds import CameraNoise, camera_clouds, complete_cloud
from placement_planner_ros.scenes.primitives import box
from placement_planner_ros.scenes.scenes import SCENE_NAMES, Scene, scene_by_name

GREY = (0.5, 0.5, 0.5)
EXACT = CameraNoise(range_deviation=0.0, flying_share=0.0)
VOLUME = TargetVolume(np.array([-0.1, -0.1, 0.0]), np.array([0.1, 0.1, 0.1]))


def depth(scene: Scene, points: np.ndarray) -> np.ndarray:
    """How deep points lie in the union of the scene's parts (outside: negative, at least -5 cm)."""
    result = np.full(len(points), -0.05)
    for part in scene.parts:
        low, high = part.vertices.min(axis=0) - 0.05, part.vertices.max(axis=0) + 0.05
        rows = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
        result[rows] = np.maximum(result[rows], part.depth(points[rows]))
    return result


@pytest.fixture(scope="module", params=SCENE_NAMES)
def scene(request: pytest.FixtureRequest) -> Scene:
    return scene_by_name(request.param)


def block_on_ground() -> Scene:
    ground = box("ground", (-0.2, -0.2, -0.1), (0.2, 0.2, 0.0), GREY)
    return Scene(
        "block", VOLUME, (ground, box("block", (-0.05, -0.05, 0), (0.05, 0.05, 0.1), GREY))
    )


def test_every_point_lies_on_the_surface_of_the_union(scene: Scene) -> None:
    cloud = complete_cloud(scene)
    np.testing.assert_allclose(depth(scene, cloud), 0, atol=1e-7)


def test_the_whole_surface_is_covered(scene: Scene) -> None:
    """Any point of any face that nothing is pressed against has a neighbour in the cloud."""
    tree = cKDTree(complete_cloud(scene))
    rng = np.random.default_rng(0)
    checked = 0
    for part in scene.parts:
        a, b, c = (part.vertices[part.triangles[:, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        area = np.linalg.norm(normals, axis=1)
        rows = rng.choice(len(area), 300, p=area / area.sum())
        weights = rng.dirichlet((1, 1, 1), 300)
        points = np.einsum("ij,jik->ik", weights, np.array([a[rows], b[rows], c[rows]]))
        outside = points + 0.004 * normals[rows] / area[rows, None]
        points = points[depth(scene, outside) < -0.0035]
        checked += len(points)
        if len(points):
            assert tree.query(points)[0].max() <= 0.005 * np.sqrt(0.5) + 1e-6, part.name
    assert checked > 1000


def test_holds_corners_and_edges_exactly() -> None:
    cloud = complete_cloud(block_on_ground(), spacing=0.03)
    tree = cKDTree(cloud)
    corners = [[x, y, z] for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (0, 0.1)]
    assert tree.query(corners)[0].max() < 1e-12
    edge = cloud[(cloud[:, 1] == 0.05) & (cloud[:, 2] == 0.1)]
    assert sorted(np.round(edge[:, 0], 9)) == [-0.05, -0.025, 0, 0.025, 0.05]


def test_cameras_see_surfaces_and_only_in_front(scene: Scene) -> None:
    for cloud in camera_clouds(scene, np.random.default_rng(0), noise=EXACT):
        points = cloud.world_points()
        assert np.abs(depth(scene, points)).max() < 1e-6  # float32
        eye = cloud.camera.T_world_camera.translation
        some = points[:: len(points) // 200]
        for share in np.linspace(0.02, 0.995, 25):
            assert (depth(scene, eye + share * (some - eye)) < 0).all()


def test_clouds_are_organised_with_nan_where_nothing_is() -> None:
    scene = scene_by_name("table")
    clouds = camera_clouds(scene, np.random.default_rng(0), noise=EXACT)
    assert len(clouds) == 2
    for cloud in clouds:
        assert cloud.points.shape == (480, 640, 3)
        assert cloud.points.dtype == np.float32
        missing = np.isnan(cloud.points)
        assert (missing.all(axis=2) == missing.any(axis=2)).all()
        assert 0.05 < missing.mean() < 0.8
        x, y, z = np.moveaxis(cloud.points, 2, 0)
        v, u = np.nonzero(np.isfinite(z))
        f = cloud.camera.focal_length
        np.testing.assert_allclose(x[v, u] / z[v, u] * f + 319.5, u, atol=1e-2)
        np.testing.assert_allclose(y[v, u] / z[v, u] * f + 239.5, v, atol=1e-2)
        assert (z[v, u] > 0).all()
