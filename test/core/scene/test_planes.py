"""Sloping surfaces: their planes, and regions and support on them, against plain geometry."""

import numpy as np
import pytest
from helpers.tilts import slope_of

from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.types import LEVEL, TargetVolume, steepness

VOLUME = TargetVolume([-0.25, -0.2, -0.1], [0.25, 0.2, 0.15])
BOUNDS = (np.array([-0.6, -0.6, -0.4]), np.array([0.6, 0.6, 0.6]))
STEEPEST = 0.26
SENSOR = np.array([0.1, -0.2, 1.5])
FLOOR = np.tile([1.5, 0.0, -1.0], (12, 1))
"""Far beside what is looked at: so the sensor tells what lies below."""


def patch(lower, upper, slope, height=0.013, spacing=0.004, angle=0.0):
    """(n, 3) points of a rectangle turned by an angle about z, on the plane z = h + slope · xy."""
    xy = np.stack(
        np.meshgrid(*[np.arange(a, b, spacing) for a, b in zip(lower, upper, strict=True)]), -1
    ).reshape(-1, 2)
    c, s = np.cos(angle), np.sin(angle)
    xy = xy @ np.array([[c, s], [-s, c]])
    return np.column_stack([xy, height + xy @ np.array(slope)])


def environment_of(*patches, noise=0.0, max_slope=STEEPEST, seed=0):
    points = np.vstack(patches)
    if noise:
        points = points + np.random.default_rng(seed).normal(0.0, noise, points.shape)
    settings = RegionSettings(max_slope=max_slope)
    sights = [View(np.vstack([points, FLOOR]), SENSOR)]  # noise makes holes of 8 mm and more
    return Environment.from_points(points, VOLUME, None, settings, BOUNDS, sights=sights)


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.003])
@pytest.mark.parametrize("degrees", [0.4, 1.0, 3.0, 5.0, 9.0, 14.5])
def test_a_tilted_table_has_the_slope_it_has_and_is_region_all_over(degrees, noise):
    slope = slope_of(degrees, 0.7)
    made = environment_of(patch((-0.4, -0.4), (0.4, 0.4), slope), noise=noise)
    assert [each.slope for each in made.inclines] == [pytest.approx(slope, abs=0.001)]
    assert {region.slope for region in made.regions} == {made.inclines[0].slope}
    xy = np.random.default_rng(1).uniform(VOLUME.lower[:2], VOLUME.upper[:2], (4000, 2))
    z = 0.013 + xy @ slope
    within = (z > VOLUME.lower[2] + 0.002) & (z < VOLUME.upper[2] - 0.002)
    share = sum(region.area for region in made.regions) / 0.2  # V is 0.5 x 0.4 m
    assert share >= 0.97 * within.mean()
    for region in made.regions:
        corners = region.rectangles[:, :2]
        assert np.abs(region.heights(corners) - 0.013 - corners @ slope).max() < 0.0007
    supported = made.inclines[0].support.supported(np.column_stack([xy, z]), 0.003, 0.003)
    assert supported.mean() > 0.99
    off = np.column_stack([xy, z + np.where(xy[:, 0] > 0.0, 1.0, -1.0) * (0.0045 + noise)])
    assert not made.inclines[0].support.supported(off, 0.003).any()


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.003])
def test_what_noise_explains_is_level_and_an_ideal_level_table_exactly_so(noise):
    """Also tops of 4 to 6.5 cm, of a point or two a cell."""
    for seed in range(12):
        rng = np.random.default_rng(seed)
        points = [patch((-0.4, -0.4), (0.4, 0.4), LEVEL, angle=seed)]
        for x, y in np.mgrid[-0.15:0.2:0.1, -0.1:0.15:0.1].reshape(2, -1).T:
            half = np.full(2, rng.uniform(0.02, 0.0325))
            points.append(patch(-half, half, LEVEL, 0.08, 0.008, seed + x) + np.array((x, y, 0.0)))
        made = environment_of(*points, noise=noise, seed=seed)
        assert made.inclines == ()
        assert {region.slope for region in made.regions} == {LEVEL}


def test_steeper_surfaces_are_no_support_and_are_told_with_their_angle():
    steep = patch((0.0, -0.4), (0.4, 0.4), slope_of(7.0, 0.0))
    level = patch((-0.4, -0.4), (0.0, 0.4), LEVEL)
    made = environment_of(level, steep, max_slope=0.1)
    assert [np.degrees(steepness(each.slope)) for each in made.steep] == [pytest.approx(7.0, 0.02)]
    assert made.inclines == ()
    within = 0.003 / np.tan(np.radians(7.0))  # as far it is level within the contact's tolerance
    assert max(region.rectangles[:, 2].max() for region in made.regions) < within
    at = np.column_stack([np.full(50, 0.03), np.linspace(-0.1, 0.1, 50), np.full(50, 0.0167)])
    assert not made.support.supported(at, 0.003).any()
    allowed = environment_of(level, steep, max_slope=0.13)
    assert allowed.steep == ()
    assert {region.slope for region in allowed.regions} == {LEVEL, allowed.inclines[0].slope}


def test_each_of_two_slopes_carries_only_what_stands_along_it():
    """A roof: what stands along one side is not carried by the other."""
    right, left = slope_of(4.0, np.pi), slope_of(5.0, 0.0)
    made = environment_of(
        patch((0.0, -0.4), (0.4, 0.4), right), patch((-0.4, -0.4), (0.0, 0.4), left)
    )
    assert {np.sign(each.slope[0]) for each in made.inclines} == {1.0, -1.0}
    rng = np.random.default_rng(2)
    xy = rng.uniform([-0.2, -0.15], [0.2, 0.15], (4000, 2))
    for each in made.inclines:
        own = np.sign(xy[:, 0]) == -np.sign(each.slope[0])
        z = 0.013 + xy @ np.array(each.slope)
        carried = each.support.supported(np.column_stack([xy, z]), 0.003)
        assert carried[own & (np.abs(xy[:, 0]) > 0.02)].all()
        assert not carried[~own & (np.abs(xy[:, 0]) > 0.025)].any()
        for region in made.regions:
            if region.slope == each.slope:
                side = -np.sign(each.slope[0]) * region.rectangles[:, [0, 2]]
                assert side.min() > -0.021


def test_small_knobs_on_a_noisy_table_are_not_taken_for_noise():
    """Domes 6 mm high and 23 mm wide every 50 mm, measured from above with 0.9 mm of noise."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(-0.2, 0.2, (60_000, 2))
    place = (xy + 0.025) % 0.05 - 0.025
    radius, height = 0.014, 0.006
    dome = np.sqrt(np.maximum(radius**2 - (place**2).sum(axis=1), 0.0)) - radius + height
    points = np.column_stack([xy, np.maximum(dome, 0.0) + rng.normal(0.0, 0.0009, len(xy))])
    volume = TargetVolume(np.array([-0.2, -0.2, -0.05]), np.array([0.2, 0.2, 0.2]))
    obstacles = Environment.from_points(points, volume).obstacles
    middles = np.stack(np.meshgrid(*2 * [np.arange(-0.15, 0.16, 0.05)]), axis=-1).reshape(-1, 2)
    lower, upper = obstacles.lower[:, None], obstacles.upper[:, None]
    over = (lower[..., :2] <= middles + 0.004).all(axis=2)
    over &= (upper[..., :2] >= middles - 0.004).all(axis=2)
    highest = np.where(over, upper[..., 2], -1.0).max(axis=0)
    assert (highest > 0.004).mean() > 0.85
    # Between them the table is level.
    centers = 0.5 * (obstacles.lower + obstacles.upper)[:, :2]
    between = np.abs((centers + 0.025) % 0.05 - 0.025).max(axis=1) > 0.02
    assert between.any()
    assert (obstacles.upper[between, 2] < 0.0025).mean() > 0.95
