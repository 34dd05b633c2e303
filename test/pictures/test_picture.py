"""Pictures show what they are to show, and nothing in front of what hides it."""

import numpy as np
import pytest

from placement_planner_ros.pictures.rendering import Mesh, camera_around, render
from placement_planner_ros.scenes.clouds import DepthCamera
from placement_planner_ros.scenes.primitives import box

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def plate(height: float, colour: tuple, half: float = 0.1, glass: bool = False) -> Mesh:
    solid = box("plate", (-half, -half, height - 0.01), (half, half, height), colour)
    return Mesh(solid.vertices[solid.triangles], colour, glass)


def from_above(*meshes: Mesh) -> DepthCamera:
    points = np.vstack([mesh.corners.reshape(-1, 3) for mesh in meshes])
    return camera_around(points, (-np.pi / 2, 1.5), (80, 60))


def middle(image: np.ndarray) -> np.ndarray:
    return image[30, 40]


@pytest.mark.parametrize("order", [1, -1])
def test_the_nearer_mesh_is_seen_whatever_the_order(order: int) -> None:
    meshes = [plate(0.0, RED), plate(0.2, BLUE, half=0.05)][::order]
    image = render(from_above(*meshes), meshes)
    assert middle(image.colours)[2] > 0.4
    assert middle(image.colours)[0] == 0
    assert (image.colours[..., 0] > 0.4).any()


def test_glass_tints_a_quarter_of_what_is_behind_and_only_that() -> None:
    glass, below = plate(0.2, BLUE, glass=True), plate(0.0, RED)
    view = from_above(glass, below)
    both, bare = render(view, [glass, below]), render(view, [below])
    tinted = both.colours[20:40, 30:50].reshape(-1, 3)
    assert (tinted[:, 2] > 0.4).mean() == 0.25
    assert (tinted[tinted[:, 2] == 0] == middle(bare.colours)).all()
    hidden = render(view, [plate(-0.2, BLUE, half=0.02, glass=True), below])
    np.testing.assert_array_equal(hidden.colours, bare.colours)


def test_everything_fits_into_the_view() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        points = rng.normal(size=(20, 3)) * rng.uniform(0.1, 1, 3)
        view = camera_around(points, (rng.uniform(-3, 3), rng.uniform(-1.2, 1.2)), (300, 200))
        u, v, depth = view.project(points).T
        assert (depth > 0).all()
        assert u.min() >= 0
        assert u.max() <= 300
        assert v.min() >= 0
        assert v.max() <= 200
        assert max(np.ptp(u) / 300, np.ptp(v) / 200) > 0.8
