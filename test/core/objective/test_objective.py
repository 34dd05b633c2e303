"""Clearance as an objective: its sign, and its gradient against differences of its values."""

import numpy as np
import pytest
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import (
    ObjectiveContext,
    evaluate_objective,
    moved_pose,
    objective_gradient,
)

CASE = Case("cabinet_high_clutter", "wine_glass", "maximize_clearance")


@pytest.fixture(scope="module")
def problem():
    return problem_of(CASE)[0]


def objective_of(problem, name):
    return make_objective(name, ObjectiveContext(problem.environment, problem.volume, problem.body))


def poses_above_the_shelves(problem, rng, count):
    """The goblet upright, low over the places where it could stand."""
    face = problem.body.faces[0].T_face_object
    regions = problem.environment.regions
    for k in range(count):
        pose = face.copy()
        pose.translation = face.translation + regions[k % len(regions)].sample(rng)
        yield moved_pose(pose, np.array([0.0, 0.0, rng.uniform(-3.0, 3.0)]))


@pytest.mark.parametrize("name", ["maximize_clearance", "minimize_clearance"])
def test_the_gradient_is_the_change_of_the_value(problem, name):
    objective = objective_of(problem, name)
    steep = 0
    for pose in poses_above_the_shelves(problem, np.random.default_rng(0), 60):
        own = objective_gradient(objective, pose)
        numeric = objective_gradient(lambda T: evaluate_objective(objective, T), pose, 1e-4, 1e-3)
        np.testing.assert_allclose(own, numeric, atol=0.03)
        steep += np.linalg.norm(own) > 0.3
    assert steep > 30


def test_one_clearance_is_the_other_with_the_sign_turned(problem):
    most, least = (objective_of(problem, f"{n}_clearance") for n in ("maximize", "minimize"))
    for pose in poses_above_the_shelves(problem, np.random.default_rng(2), 10):
        assert most(pose) > 0.0
        assert least(pose) == -most(pose)
        np.testing.assert_array_equal(
            objective_gradient(least, pose), -objective_gradient(most, pose)
        )
