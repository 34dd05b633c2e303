"""Gaps that lines of sight prove, and that what a camera missed is none."""

import numpy as np
import pytest
from helpers.gratings import BOUNDS, HALF, VOLUME, Z, at, bars, outline, solid

from placement_planner_ros.core.scene.environment import find_regions
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.core.scene.planes import Planes
from placement_planner_ros.core.scene.regions import RegionSettings

PIXEL = 0.003
"""m between what neighbouring pixels see unless given: one or two across a bar of 5 mm."""
BELOW = Z - 0.08
"""m, height of what is seen through the gaps."""
SENSOR = np.array([-0.25, 0.05, 0.75])


def seen(inside, rng, noise=0.0, sensor=SENSOR, missing=0.0, pixel=PIXEL):
    """(n, 3) what a camera sees of a surface, and of a floor through its gaps."""
    x, y = np.mgrid[-1.3 * HALF : 1.3 * HALF : pixel, -1.3 * HALF : 1.3 * HALF : pixel]
    shift = rng.uniform(0.0, pixel, 2)
    xy = np.stack([x, y], axis=-1).reshape(-1, 2) + shift
    on_it = (inside(xy) >= 0.0) & (outline(xy) >= 0.0)
    points = at(xy)
    share = (sensor[2] - BELOW) / (sensor[2] - Z)
    points[~on_it] = sensor + share * (points[~on_it] - sensor)
    along = (points - sensor) / np.linalg.norm(points - sensor, axis=1)[:, None]
    points += along * rng.normal(0.0, noise, len(points))[:, None] if noise else 0.0
    points[rng.random(len(points)) < missing] = np.nan
    return points


def support_of(points, sensor=None):
    obstacles = ObstacleSet.from_points(points, GridSettings(cell_size=0.01), BOUNDS)
    sights = [] if sensor is None else [View(points, sensor)]
    return find_regions(obstacles, VOLUME, sights=sights)[1]


def shares(support, inside, rng):
    """Of what is well within gaps, and within the solid, how much counts as support."""
    xy = rng.uniform(-0.8 * HALF, 0.8 * HALF, (4000, 2))
    depth = inside(xy)
    supported = support.supported(at(xy), 0.004)
    return supported[depth < -0.002].mean(), supported[depth > 0.001].mean()


@pytest.mark.parametrize(("gap", "angle"), [(0.010, 0.0), (0.010, 0.4), (0.015, 1.2)])
def test_thin_bars_of_which_a_camera_sees_a_point_or_two_across_have_gaps(gap, angle):
    rng = np.random.default_rng(0)
    grating = bars(0.005, gap, angle)
    points = seen(grating, rng, pixel=0.004)
    in_gaps, on_bars = shares(support_of(points, SENSOR), grating, rng)
    assert in_gaps <= 0.002
    assert on_bars >= 0.09  # bars of little more than a pixel: what is safe to lose


@pytest.mark.parametrize(("gap", "angle"), [(0.010, 0.0), (0.010, 0.4), (0.015, 1.2)])
def test_sights_take_hardly_anything_from_bars_whose_gaps_the_points_tell(gap, angle):
    rng = np.random.default_rng(0)
    grating = bars(0.005, gap, angle)
    points = seen(grating, rng)
    _, alone = shares(support_of(points), grating, rng)
    in_gaps, on_bars = shares(support_of(points, SENSOR), grating, rng)
    assert in_gaps <= 0.002
    assert on_bars >= alone - 0.05 >= 0.4


@pytest.mark.parametrize(("noise", "missing"), [(0.0, 0.0), (0.002, 0.3)])
def test_what_a_camera_missed_and_what_it_saw_beyond_the_edges_makes_no_gap(noise, missing):
    rng = np.random.default_rng(1)
    points = seen(solid, rng, noise, missing=missing)
    before, after = support_of(points), support_of(points, SENSOR)
    xy = rng.uniform(-0.85 * HALF, 0.85 * HALF, (4000, 2))
    supported = after.supported(at(xy), 0.004, 0.003)
    assert supported[before.supported(at(xy), 0.004, 0.003)].all()
    assert supported.mean() > 0.9


def test_a_surface_that_slopes_has_gaps_too():
    rng = np.random.default_rng(2)
    grating, slope = bars(0.005, 0.010, 0.4), (0.05, -0.03)
    points, sensor = seen(grating, rng), SENSOR + np.array([0.0, 0.0, SENSOR[:2] @ slope])
    points[:, 2] += points[:, :2] @ slope
    obstacles = ObstacleSet.from_points(points, GridSettings(cell_size=0.01), BOUNDS)
    planes = Planes.of(obstacles, VOLUME, RegionSettings(max_slope=0.1))
    (found,) = planes.slopes
    assert found == pytest.approx(slope, abs=0.002)
    sights = [View(points, sensor)]
    support = find_regions(obstacles, VOLUME, planes=planes, slope=found, sights=sights)[1]
    xy = rng.uniform(-0.8 * HALF, 0.8 * HALF, (4000, 2))
    raised = at(xy)
    raised[:, 2] += xy @ slope
    depth, stands = grating(xy), support.supported(raised, 0.004)
    assert stands[depth < -0.002].mean() <= 0.002
    assert stands[depth > 0.001].mean() > 0.4
