"""`support_region`: largest keeps to the largest surface and what is level with it."""

import numpy as np
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.scene.environment import level_with_largest
from placement_planner_ros.core.scene.regions import Region


def region(x, width, z, slope=(0.0, 0.0)):
    return Region(np.array([[x, 0.0, x + width, 0.3]]), z, slope)


def test_the_largest_surface_counts_as_a_whole_and_what_is_level_with_it_is_kept():
    tiles = [region(0.0, 0.2, 0.1), region(0.2, 0.2, 0.1)]
    chest, level, ramp = (
        region(1.0, 0.3, 0.4),
        region(2.0, 0.1, 0.1015),
        region(3.0, 0.3, 0.1, (0.05, 0.0)),
    )
    kept = level_with_largest((chest, *tiles, level, ramp))
    assert kept == (*tiles, level)
    assert level_with_largest((chest, ramp)) == (chest,)
    assert level_with_largest(()) == ()


def test_nothing_is_placed_on_top_of_other_things_where_so_asked():
    problem, _ = problem_of(
        Case("cabinet_high_clutter", "small_crayons_box", "maximize_clearance"), 0
    )
    level = level_with_largest(problem.environment.regions)

    def height(T_world_object):
        return float(T_world_object.translation[2])

    settings = PlannerSettings(support_region="largest")
    planner = PlacementPlanner(problem, height, settings, np.random.default_rng(0))
    found = list(planner.run(lambda: planner.statistics.samples >= 6000))
    assert found
    assert max(region.z for region in problem.environment.regions) > level[0].z + 0.01
    for placement in found:
        assert min(abs(placement.goal.contact_height - r.z) for r in level) < 0.004
