"""What depends on robot and object alone is made before an environment is known."""

from dataclasses import replace

import pinocchio as pin
import pytest
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision import arm as arm_module
from placement_planner_ros.core.errors import GraspError
from placement_planner_ros.core.grasp.feasible_grasps import lay_out_holdings, usable_holdings
from placement_planner_ros.core.grasp.settings import GraspSettings
from placement_planner_ros.scenes.objects import object_by_name

SETTINGS = GraspSettings()


@pytest.fixture(scope="module")
def problem():
    return problem_of(Case("table", "small_crayons_box", "maximize_clearance"))[0]


def new_body():
    """One of which nothing is remembered."""
    held = object_by_name("small_crayons_box")
    return Body.from_mesh(held.vertices, held.triangles, held.center_of_mass)


def lay_out(problem):
    lay_out_holdings(problem.robot, problem.arms, problem.q_start, problem.body, SETTINGS)


def test_once_there_is_an_environment_nothing_is_laid_out_anew(problem, monkeypatch):
    ready = replace(problem, body=new_body())
    lay_out(ready)

    def anew(*_):
        raise AssertionError("laid out anew")

    monkeypatch.setattr(arm_module, "flatten", anew)
    holdings, why_not = usable_holdings(ready, SETTINGS)
    assert [len(of_arm) for of_arm in holdings] == [len(arm.grasps) for arm in problem.arms]
    assert why_not == ()
    with pytest.raises(AssertionError, match="anew"):
        usable_holdings(replace(problem, body=new_body()), SETTINGS)


def test_grasps_that_cannot_be_used_are_left_to_the_search(problem):
    arms = tuple(replace(arm, grasps=(pin.SE3.Identity(),)) for arm in problem.arms)
    bad = replace(problem, arms=arms)
    lay_out(bad)
    with pytest.raises(GraspError):
        usable_holdings(bad, SETTINGS)
