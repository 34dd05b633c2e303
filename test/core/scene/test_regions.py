"""Placement regions, splitting, sampling, and support."""

import numpy as np
import pytest
from helpers.points import BOUNDS, plane

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.scene.environment import Environment, find_regions
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.regions import Region, RegionSettings
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.clouds import camera_clouds, complete_cloud
from placement_planner_ros.scenes.scenes import SCENE_NAMES, scene_by_name

VOLUME = TargetVolume(np.array([-0.4, -0.4, -0.1]), np.array([0.4, 0.4, 0.5]))


def regions_of(points, volume=VOLUME, **settings):
    obstacles = ObstacleSet.from_points(points, bounds=BOUNDS)
    return find_regions(obstacles, volume, RegionSettings(**settings))


def block(lower, upper):
    """The five visible sides of a box that stands on something."""
    (x0, y0, z0), (x1, y1, z1) = lower, upper
    return np.vstack(
        [
            plane((x0, y0, z1), (x1, y1, z1)),
            plane((x0, y0, z0), (x0, y1, z1)),
            plane((x1, y0, z0), (x1, y1, z1)),
            plane((x0, y0, z0), (x1, y0, z1)),
            plane((x0, y1, z0), (x1, y1, z1)),
        ]
    )


def turned(points, angle, center=(0.0, 0.0)):
    c, s = np.cos(angle), np.sin(angle)
    result = points.copy()
    result[:, :2] = (points[:, :2] - center) @ np.array([[c, s], [-s, c]]) + center
    return result


def test_regions_on_the_floor_and_on_things_and_on_narrow_ledges():
    points = np.vstack(
        [
            plane((-0.3, -0.3, 0.0127), (0.3, 0.3, 0.0127)),
            block((-0.2, -0.2, 0.0127), (-0.05, -0.1, 0.1234)),
            block((0.1, -0.2, 0.0127), (0.113, 0.2, 0.2)),
        ]
    )
    regions, _ = regions_of(points)
    heights = np.array([r.z for r in regions])
    for expected, area in ((0.1234, 0.15 * 0.1), (0.2, 0.013 * 0.4)):
        here = np.abs(heights - expected) < 1e-6
        assert sum(r.area for r in np.array(regions)[here]) == pytest.approx(
            area, rel=0.1
        )  # to half a pixel
    assert set(np.round(heights, 6)) == {0.0127, 0.1234, 0.2}
    floor = sum(r.area for r in regions if r.z < 0.02)
    assert floor >= 0.36 - 0.015 - 0.0052 - 0.01  # what lies beneath the hollow blocks is floor too
    assert [r.area for r in regions] == sorted((r.area for r in regions), reverse=True)


def test_slopes_and_walls_and_low_gaps_are_no_regions():
    flat = plane((-0.2, -0.2, 0.0), (0.2, 0.2, 0.0), 0.003)
    for degrees in (6, 12, 30, 60):
        tilt = np.radians(degrees)
        slope = flat.copy()
        slope[:, 0], slope[:, 2] = flat[:, 0] * np.cos(tilt), 0.2 + flat[:, 0] * np.sin(tilt)
        regions, _ = regions_of(slope)
        assert sum(r.area for r in regions) < 0.1 * 0.16 * np.cos(tilt)
    regions, _ = regions_of(plane((-0.2, 0.1, 0.0), (0.2, 0.1, 0.3)))
    assert regions == ()
    lid = flat + np.array([0.0, 0.0, 0.025])
    regions, _ = regions_of(np.vstack([flat, lid]), headroom=0.03)
    assert {round(r.z, 4) for r in regions} == {0.025}
    regions, _ = regions_of(np.vstack([flat, lid]), headroom=0.02)
    assert {round(r.z, 4) for r in regions} == {0.0, 0.025}


def of_boxes(*boxes):
    corners = np.array(boxes).reshape(-1, 2, 3)
    return TargetVolume(corners[:, 0], corners[:, 1])


def test_regions_lie_in_the_union_of_boxes_and_fill_it():
    """Two boxes that overlap, one apart, one at another height, one beyond the surface."""
    points = np.vstack([plane((-0.3, -0.3, z), (0.3, 0.3, z), 0.004) for z in (0.0999, 0.1999)])
    boxes = [
        [[-0.251, -0.2, 0.05], [-0.1, 0.0, 0.15]],
        [[-0.2, -0.1, 0.09], [0.0, 0.053, 0.11]],
        [[0.1, 0.1, 0.0], [0.2, 0.2, 0.12]],
        [[0.1, -0.2, 0.18], [0.2, -0.1, 0.3]],
        [[0.35, 0.0, 0.0], [0.4, 0.1, 0.3]],
    ]
    volume = of_boxes(*boxes)
    regions, _ = regions_of(points, volume)
    rng = np.random.default_rng(0)
    for z, area in ((0.0999, 0.151 * 0.2 + 0.2 * 0.153 - 0.01 + 0.01), (0.1999, 0.01)):
        level = [r for r in regions if abs(r.z - z) < 1e-4]
        assert sum(r.area for r in level) == pytest.approx(area, rel=1e-9)
        samples = np.array([r.sample(rng) for r in level for _ in range(200)])
        assert volume.contains(samples).all()
        for x, y in rng.uniform(-0.29, 0.29, (400, 2)):
            times = sum(
                ((r.rectangles[:, :2] < (x, y)) & (r.rectangles[:, 2:] > (x, y))).all(axis=1).sum()
                for r in level
            )
            assert times == volume.contains(np.array([[x, y, level[0].z]]))[0]


def test_split_covers_exactly_and_goes_on_down_to_nothing():
    regions, _ = regions_of(turned(plane((-0.1, -0.1, 0.1), (0.1, 0.1, 0.1), 0.003), 0.3))
    region = regions[0]
    parts = region.split()
    assert 2 <= len(parts) <= 4
    assert sum(p.area for p in parts) == pytest.approx(region.area, rel=1e-9)
    mean = np.average(
        0.5 * (region.rectangles[:, :2] + region.rectangles[:, 2:]), axis=0, weights=region.areas
    )
    for part in parts:
        low, high = part.rectangles[:, :2].min(axis=0), part.rectangles[:, 2:].max(axis=0)
        assert all(
            h <= m + 1e-12 or a >= m - 1e-12 for a, h, m in zip(low, high, mean, strict=True)
        )
    smallest = Region(np.array([[0.0, 0.0, 0.1, 0.2]]), 0.3)
    for _ in range(20):
        smallest = smallest.split()[-1] if smallest.split() else smallest
    assert 0.0 < smallest.area < 1e-11


def test_empty_environment_has_no_regions():
    environment = Environment.from_points(np.zeros((0, 3)), VOLUME, bounds=BOUNDS)
    assert environment.regions == ()
    assert not environment.support.supported(np.zeros((3, 3)), 0.003).any()


@pytest.mark.parametrize(
    "change",
    [{"headroom": 0.0}, {"max_side": float("nan")}, {"min_area": -1.0}, {"max_regions": 0}],
)
def test_bad_settings_are_refused(change):
    with pytest.raises(ParameterError):
        RegionSettings(**change)


@pytest.mark.parametrize("name", SCENE_NAMES)
@pytest.mark.parametrize("camera", [False, True])
def test_regions_of_the_bundled_scenes_lie_on_their_surfaces(name, camera):
    scene = scene_by_name(name)
    bounds = (np.array([-0.2, -0.9, -0.3]), np.array([1.1, 0.9, 0.9]))
    rng = np.random.default_rng(7)
    if camera:
        points = np.vstack([cloud.world_points() for cloud in camera_clouds(scene, rng)])
    else:
        points = complete_cloud(scene, bounds=bounds)
    environment = Environment.from_points(points, scene.volume, bounds=bounds)
    tops = {round(float(part.vertices[:, 2].max()), 6) for part in scene.parts}
    undersides = {round(float(part.vertices[:, 2].min()), 6) for part in scene.parts}
    height_error = 0.002 if camera else 0.001
    large = [region for region in environment.regions if region.area > 0.002]
    assert len(large) >= 8
    for region in large:
        # the underside of a shelf is the top of the hollow that a thing on the shelf encloses
        assert min(abs(region.z - z) for z in tops | undersides) < height_error
    samples = np.array([region.sample(rng) for region in large for _ in range(100)])
    below = samples - np.array([0.0, 0.0, height_error])
    depth = np.max([part.depth(below) for part in scene.parts], axis=0)
    beyond = depth < (-0.004 if camera else -0.002)
    assert beyond.mean() < (0.02 if camera else 0.005)
    # of the rest, regions reach a little further than what points surround
    assert environment.support.supported(samples, 0.003).mean() > 0.96
