"""Flying pixels go, and what is really there stays, however thin."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from placement_planner_ros.core.scene.flying_pixels import flying_pixels
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.scenes.clouds import (
    CameraNoise,
    DepthCamera,
    camera_clouds,
    complete_cloud,
)
from placement_planner_ros.scenes.primitives import standing_box
from placement_planner_ros.scenes.scenes import SCENE_NAMES, scene_by_name

FOCAL = 340.0
WALL = 0.5
"""m behind what is looked at, which is 1 m away."""
CLEAN = CameraNoise(range_deviation=0.002, flying_share=0.0)
FLYING = replace(CLEAN, flying_share=0.05, stray_share=0.05)


def views_of(scene, noise, seed=0):
    """Of each camera its points (n, 3) and where it is."""
    for cloud in camera_clouds(scene, np.random.default_rng(seed), noise=noise):
        yield cloud.world_points(), cloud.camera.T_world_camera.translation


def image(thing, noise, seed=0, steep=0.0):
    """Points (h, w, 3) in the frame of a camera that looks at a wall with a thing before it.

    Args:
        thing: of the pixels' rays (x, y at a depth of 1 m), which hit it 1 m away.
        steep: by how much more its depth grows along x.
    """
    y, x = (np.mgrid[-60:61, -80:81] + 0.13) / FOCAL
    on_it = thing(x, y)
    depth = np.where(on_it, 1.0 / (1.0 - steep * x), 1.0 + WALL)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    error = np.random.default_rng(seed).normal(0.0, noise, x.shape) if noise else 0.0
    return rays * depth[..., None] + rays * (error / np.linalg.norm(rays, axis=-1))[
        ..., None
    ], on_it


def band(width):
    """A thing that crosses the image, obliquely, this wide at 1 m."""
    return lambda x, y: abs(x - 0.3 * y) <= 0.5 * width * np.hypot(1.0, 0.3)


THIN = {
    "stem of 8 mm": band(0.008),
    "cable of 5 mm": band(0.005),
    "bars of 5 mm": lambda x, y: np.mod(x, 0.025) < 0.005,
    "wire of one pixel": lambda x, y: np.floor(x * FOCAL) == np.floor(0.3 * y * FOCAL),
    "stick of 5 by 30 mm": lambda x, y: (abs(x) < 0.0025) & (abs(y) < 0.015),
    "tile of 6 mm": lambda x, y: (abs(x) < 0.003) & (abs(y) < 0.003),
    "four pixels": lambda x, y: (abs(x) < 1.0 / FOCAL) & (abs(y) < 1.0 / FOCAL),
}


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.002])
@pytest.mark.parametrize("name", THIN)
def test_thin_things_stay(name, noise):
    points, on_it = image(THIN[name], noise)
    assert on_it.sum() >= 4
    gone = flying_pixels(points.reshape(-1, 3), np.zeros(3)).reshape(on_it.shape)
    assert gone[on_it].mean() <= 0.01
    assert gone.mean() <= 1e-3
    # boxes cover it as they did
    bounds = [-0.3, -0.3, 0.8], [0.3, 0.3, 1.7]
    shares = []
    for cloud in (points.reshape(-1, 3), points[~gone]):
        made = ObstacleSet.from_points(cloud, bounds=bounds)
        cells = np.floor((points[on_it] - made.origin) / made.cell_size).astype(int)
        shares.append((made.number_at[tuple(cells.T)] > 0).mean())
    assert shares[0] > 0.9
    assert shares[1] >= shares[0] - 0.01


@pytest.mark.parametrize(
    ("name", "steep"), [("stem of 8 mm", 8.0), ("bars of 5 mm", 8.0), ("wire of one pixel", 5.0)]
)
def test_what_is_seen_steeply_stays(name, steep):
    turned = {"wire of one pixel": lambda x, y: np.floor(y * FOCAL) == 0}
    thing = turned.get(name, THIN[name])
    points, on_it = image(lambda x, y: thing(x, y) & (abs(x) < 0.08), 0.001, steep=steep)
    gone = flying_pixels(points.reshape(-1, 3), np.zeros(3)).reshape(on_it.shape)
    assert gone[on_it].mean() <= 0.05


def test_two_pixels_before_a_surface_are_not_told_from_flying_ones():
    beside = 0.5 / FOCAL
    points, on_it = image(
        lambda x, y: (abs(x - beside) < 2.0 * beside) & (abs(y) < 1.2 * beside), 0.001
    )
    assert on_it.sum() == 2
    gone = flying_pixels(points.reshape(-1, 3), np.zeros(3)).reshape(on_it.shape)
    assert gone[on_it].all()


def test_a_few_pixels_with_nothing_around_them_stay():
    points, on_it = image(lambda x, y: (abs(x) < 1.7 / FOCAL) & (abs(y) < 0.6 / FOCAL), 0.001)
    points[abs(points[..., 0]) < 0.02] = np.nan
    first, _ = image(lambda x, y: (abs(x) < 1.7 / FOCAL) & (abs(y) < 0.6 / FOCAL), 0.001)
    points[on_it] = first[on_it]
    gone = flying_pixels(points.reshape(-1, 3), np.zeros(3)).reshape(on_it.shape)
    assert not gone[on_it].any()


@pytest.mark.parametrize("name", SCENE_NAMES)
def test_complete_clouds_stay_as_they_are_wherever_they_are_said_to_be_seen_from(name):
    cloud = complete_cloud(scene_by_name(name))
    for sensor in ([0.0, 0.35, 0.65], [0.0, 0.0, 0.0], [0.5, 0.0, 2.0]):
        assert not flying_pixels(cloud, np.array(sensor)).any()


def test_sparse_and_empty_clouds_stay_as_they_are():
    rng = np.random.default_rng(0)
    for points in (
        np.zeros((0, 3)),
        np.full((5, 3), np.nan),
        np.zeros((3, 3)),
        rng.uniform(-1.0, 1.0, (500, 3)),
        rng.uniform(-1.0, 1.0, (50_000, 3)),
    ):
        assert not flying_pixels(points, np.zeros(3)).any()


@pytest.mark.parametrize("name", SCENE_NAMES)
def test_camera_clouds_lose_flying_pixels_and_hardly_any_other(name):
    scene = scene_by_name(name)
    exact = CameraNoise(range_deviation=0.0, flying_share=0.0)
    for (points, sensor), (truth, _) in zip(
        views_of(scene, FLYING), views_of(scene, exact), strict=True
    ):
        off = np.linalg.norm(points - truth, axis=1)
        gone = flying_pixels(points, sensor)
        assert gone[off < 0.008].mean() <= 2e-4
        assert gone[off > 0.03].mean() >= 0.95
        clean, sensor = next(views_of(scene, CLEAN))
        assert flying_pixels(clean, sensor).mean() <= 2e-4


def boxes(*sizes_and_centres):
    """Upright boxes: length, width, height, and where their middle is on the floor."""
    return [
        standing_box(f"box {i}", (length, width, height), (x, y), 0.0, 0.0, GREY)
        for i, (length, width, height, x, y) in enumerate(sizes_and_centres)
    ]


GREY = (0.5, 0.5, 0.5)
LOW = {
    "pen along the view": boxes((0.14, 0.008, 0.008, 0.8, 0.0)),
    "pen across the view": boxes((0.008, 0.14, 0.008, 0.8, 0.0)),
    "cable along the view": boxes((0.2, 0.005, 0.005, 0.8, 0.0)),
    "cable across the view": boxes((0.005, 0.2, 0.005, 0.8, 0.0)),
    "rim of a plate": boxes(
        *(
            (0.003, 0.03, 0.02, 0.8 + 0.09 * np.cos(t), 0.09 * np.sin(t))
            for t in np.arange(0, 6, 0.3)
        )
    ),
    "peg": boxes((0.005, 0.005, 0.02, 0.8, 0.0)),
    "die of 10 mm": boxes((0.01, 0.01, 0.01, 0.8, 0.0)),
    "bars of 5 mm": boxes(*((0.005, 0.2, 0.01, 0.7 + 0.025 * i, 0.0) for i in range(8))),
}


def floor(things, noise):
    """Of a floor seen at 14°, 0.8 m off: points, the camera's place, and how far each one is before
    the floor along its ray."""
    ground = standing_box("ground", (2.0, 1.0, 0.1), (1.0, 0.0), 0.0, -0.1, GREY)
    camera = replace(
        DepthCamera.looking_at("camera", (0.0, 0.0, 0.2), (0.8, 0.0, 0.0)), width=161, height=121
    )
    seen = []
    for parts in ([ground, *things], [ground]):
        exact = CameraNoise(range_deviation=0.0, flying_share=0.0)
        for made in (exact, noise):
            [cloud] = camera_clouds(
                SimpleNamespace(parts=parts), np.random.default_rng(0), cameras=[camera], noise=made
            )
            seen.append(cloud.points.reshape(-1, 3).astype(float))
    finite = np.isfinite(np.hstack(seen)).all(axis=1)
    exact, noisy, bare, _ = (points[finite] for points in seen)
    before = np.linalg.norm(bare, axis=1) - np.linalg.norm(exact, axis=1)
    T = camera.T_world_camera
    return noisy @ T.rotation.T + T.translation, T.translation, before


@pytest.mark.parametrize("deviation", [0.0, 0.002])
@pytest.mark.parametrize("name", LOW)
def test_low_things_on_a_floor_seen_at_a_flat_angle_stay(name, deviation):
    points, eye, before = floor(LOW[name], CameraNoise(deviation, flying_share=0.0))
    on_it = before > 1e-6
    assert on_it.sum() >= 4
    gone = flying_pixels(points, eye)
    assert gone[on_it].mean() <= 0.01
    assert gone.mean() <= 2e-4


def test_what_flies_close_before_a_floor_seen_at_a_flat_angle_goes():
    noise = CameraNoise(0.001, flying_share=0.0, stray_share=0.05, stray_length=0.04)
    points, eye, _ = floor([], noise)
    height = points[:, 2]
    gone = flying_pixels(points, eye)
    assert gone[height < 0.001].mean() <= 1e-3  # of these some fly, too
    assert gone[height > 0.006].mean() >= 0.97
