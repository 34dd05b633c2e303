"""The figures that explain the search show what it does."""

import numpy as np
import pytest
from helpers.problems import problem_of

from benchmarks.__main__ import main
from benchmarks.concepts import division, edge
from benchmarks.concepts.recorded import RecordedPlanner
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.types import Verdict


@pytest.fixture(scope="module")
def problem():
    return problem_of(division.CASE, 1)


@pytest.mark.parametrize("settings", [PlannerSettings(), division.MCTS])
def test_all_that_was_checked_is_recorded(problem, settings):
    planner = RecordedPlanner(*problem, settings, np.random.default_rng(2))
    next(planner.run(lambda: False))
    places, verdicts = planner.record.places, planner.record.verdicts
    assert len(places) == len(verdicts) == planner.statistics.samples
    counted = planner.statistics.goals
    assert np.count_nonzero(verdicts == Verdict.FEASIBLE) == counted > 0


def test_no_point_moves_further_than_the_drawn_bound(problem):
    arm, q_start = problem[0].arms[0], problem[0].q_start
    chain = Chain.from_robot(problem[0].robot, arm, q_start)
    rng = np.random.default_rng(3)
    moves = edge._Moves(chain, arm.grasps[0].homogeneous, rng.uniform(-0.1, 0.1, (20, 3)))
    q, delta = q_start[arm.q_index], np.full(chain.dof, 0.1)
    strays = [
        np.linalg.norm(moves.points(q + delta * sign) - moves.points(q), axis=1).max()
        for sign in rng.uniform(-1.0, 1.0, (200, chain.dof))
    ]
    assert 0.0 < max(strays) <= moves.bound(q, delta) < 10.0 * max(strays)


def test_the_command_draws_them(tmp_path, monkeypatch):
    monkeypatch.setattr(division, "SAMPLES", 300)
    assert main(["concepts", "--output", str(tmp_path)]) == 0
    pictures = sorted(path.name for path in tmp_path.iterdir())
    assert pictures == ["concept_edge.png", "concept_search.png"]
