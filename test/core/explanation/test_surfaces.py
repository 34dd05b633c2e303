"""What is said of the surfaces in V."""

import numpy as np
import pytest

from placement_planner_ros.core.explanation import surfaces
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.visibility import View
from placement_planner_ros.core.types import TargetVolume

BOUNDS = (np.array([-0.6, -0.6, -0.6]), np.array([0.6, 0.6, 0.6]))


def plane(x, y, slope=0.0, z=0.0, spacing=0.004):
    """Points of a rectangle from x[0] to x[1] and y[0] to y[1] that rises along y."""
    grid = np.meshgrid(np.arange(*x, spacing), np.arange(*y, spacing), z)
    points = np.stack(grid, axis=-1).reshape(-1, 3)
    points[:, 2] += slope * points[:, 1]
    return points


@pytest.mark.parametrize("height", [0.003, 0.005, 0.008])
def test_a_step_between_level_surfaces_is_no_slope(height):
    """It was told as one of 11 to 27 degrees, and the sensor's pose suspected."""
    cloud = np.vstack([plane((-0.2, 0.2), (-0.3, 0.0)), plane((-0.2, 0.2), (0.0, 0.3), z=height)])
    volume = TargetVolume([-0.15, -0.012, -0.01], [0.15, 0.012, 0.02])
    environment = Environment.from_points(cloud, volume, bounds=BOUNDS)
    assert environment.regions
    assert surfaces.steep_in(environment) is None


def test_a_slope_beside_a_level_strip_is_still_named():
    steep = np.tan(np.radians(30.0))
    cloud = np.vstack([plane((-0.2, 0.2), (-0.3, 0.0)), plane((-0.2, 0.2), (0.0, 0.25), steep)])
    volume = TargetVolume([-0.15, -0.04, -0.05], [0.15, 0.2, 0.2])
    environment = Environment.from_points(cloud, volume, bounds=BOUNDS)
    assert environment.regions
    assert np.degrees(np.arctan(surfaces.steep_in(environment)[1])) == pytest.approx(30.0, abs=1.0)


def test_what_hides_most_of_the_volume_is_told():
    """Behind a screen nothing was measured, and larger surfaces were asked for."""
    volume = TargetVolume([-0.1, -0.2, -0.02], [0.2, 0.2, 0.05])
    table = plane((-0.4, 0.4), (-0.4, 0.4))
    eye = np.array([-0.4, 0.0, 0.4])
    whole = Environment.from_points(table, volume, bounds=BOUNDS, views=[View(table, eye)])
    assert surfaces.bare_in(whole) == 0.0
    assert surfaces.shown(whole) == ()
    cloud = table[table[:, 0] < -0.06]
    hidden = Environment.from_points(cloud, volume, bounds=BOUNDS, views=[View(cloud, eye)])
    assert surfaces.bare_in(hidden) > 0.8
    (remedy,) = surfaces.shown(hidden)
    assert remedy.parameter == "target_volume"
    assert f"over {surfaces.bare_in(hidden):.0%} of it" in remedy.words
    assert hidden.seen < 0.1 < whole.seen
    assert f"{hidden.seen:.0%} of target_volume" in surfaces.seen_in_words(hidden)[0]
    free = Environment.from_points(cloud, volume, bounds=BOUNDS, sights=[View(cloud, eye)])
    assert surfaces.seen_in_words(free) == ()


def test_sparse_points_are_not_taken_for_a_hidden_surface():
    volume = TargetVolume([-0.1, -0.2, -0.02], [0.2, 0.2, 0.05])
    sparse = plane((-0.4, 0.4), (-0.4, 0.4), spacing=0.03)
    environment = Environment.from_points(sparse, volume, bounds=BOUNDS)
    assert surfaces.shown(environment) == ()
    assert "too far apart" in surfaces.why_no_region(environment).cause


def test_a_wall_before_the_volume_is_not_told_as_sparse_points():
    """All that the camera sees of V's ground is the side of the wall, above V."""
    volume = TargetVolume([0.0, -0.2, -0.02], [0.3, 0.2, 0.05])
    side = plane((0.1, 0.2), (-0.3, 0.3))
    wall = side[:, [2, 1, 0]] + [0.005, 0.0, 0.0]
    environment = Environment.from_points(wall, volume, bounds=BOUNDS)
    told = surfaces.why_no_region(environment)
    assert "of target_volume nothing was measured" in told.cause
    assert told.remedies[0] == surfaces.shown(environment)[0]
