"""SampleGoals: what estimates of ξ may cost."""

import numpy as np
import pytest

from placement_planner_ros.core.objective.objective import ObjectiveContext, make_objective
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.scene.region_points import RegionPoints
from placement_planner_ros.core.types import Verdict
from placement_planner_ros.experiments.cases import Case, make_problem

SAMPLES = 6000
BLOCK = 64


def free_poses(problem, finder, rng):
    """(n, 4, 4) uniform poses at which the object stands stable and free."""
    regions = problem.environment.regions
    area = np.array([region.area for region in regions])
    chosen = rng.choice(len(area), size=SAMPLES, p=area / area.sum())
    contacts = RegionPoints(regions).sample(chosen, rng)
    faces = rng.integers(len(problem.body.faces), size=SAMPLES)
    angles = rng.uniform(0.0, 2.0 * np.pi, SAMPLES)
    verdicts, T = finder._poses.verdicts(faces, contacts, angles)
    return T[verdicts == Verdict.FEASIBLE]


@pytest.mark.parametrize("scene", ["cabinet_low_clutter", "cabinet_high_clutter", "table"])
@pytest.mark.parametrize("thing", ["wine_glass", "small_crayons_box"])
def test_estimates_hardly_ever_skip_a_better_pose_and_save_most_of_the_work(scene, thing):
    """With the objects of which estimates are off the most; ξ_best is taken to be at quantiles."""
    problem, _ = make_problem(Case(scene, thing, "maximize_clearance"), np.random.default_rng(0))
    context = ObjectiveContext(problem.environment, problem.volume, problem.body)
    better = skipped = computed = asked = 0
    for name in ("maximize_clearance", "minimize_clearance"):
        objective = make_objective(name, context)
        planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(0))
        T = free_poses(problem, planner.sampler._checker, np.random.default_rng(1))
        exact = objective.values(T)
        for seed, share in enumerate((0.5, 0.8, 0.9, 0.95, 0.98)):
            bound = float(np.quantile(exact, share))
            planner = PlacementPlanner(
                problem, objective, PlannerSettings(), np.random.default_rng(0)
            )
            finder = planner.sampler._checker
            order = np.random.default_rng(seed).permutation(len(T))
            for first in range(0, len(T), BLOCK):
                rows = order[first : first + BLOCK]
                values = finder._values(T[rows], bound)
                hot = exact[rows] > bound
                better += int(hot.sum())
                skipped += int((hot & (values <= bound)).sum())
                assert np.array_equal(values[values > bound], exact[rows][values > bound])
                computed += int((values == exact[rows]).sum())
                asked += len(rows)
    assert better > 1000
    assert skipped <= 1e-3 * better
    assert computed < 0.5 * asked
