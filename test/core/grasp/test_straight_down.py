"""The way down: the bound on how far the object strays, and the margin on all that is published."""

import numpy as np
import pytest
from helpers.robots import SLIDING
from scipy.interpolate import BPoly

from benchmarks.cases import Case, make_problem
from placement_planner_ros.core.grasp import straight_down
from placement_planner_ros.core.grasp.straight_down import StraightLines, greatest_stray
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.model import Robot


def sampled_stray(chain, points, vertices, placed, count=400):
    """The same by brute force: the distance from each line, at many instants of each piece."""
    furthest, height = 0.0, None
    for piece in points:
        curve = BPoly(piece[:, None], [0.0, 1.0])
        for q in curve(np.linspace(0.0, 1.0, count)):
            T = chain.forward(q)
            away = vertices @ T[:3, :3].T + T[:3, 3] - placed
            if height is None:
                height = max(away[:, 2].min(), 0.0)
            nearest = np.clip(away[:, 2], 0.0, height)
            away[:, 2] -= nearest
            furthest = max(furthest, np.linalg.norm(away, axis=1).max())
    return furthest


@pytest.mark.parametrize("kind", ["yumi", "sliding"])
def test_the_bound_holds_and_is_tight(kind):
    rng = np.random.default_rng(0)
    if kind == "yumi":
        problem, _ = make_problem(
            Case("table", "small_crayons_box", "maximize_clearance"), np.random.default_rng(0)
        )
        robot, arm, q = problem.robot, problem.arms[0], problem.q_start
    else:
        robot = Robot.from_urdf(SLIDING)
        arm = robot.arm("arm", "tip")
        q = np.zeros(4)
    chain = Chain.from_robot(robot, arm, q)
    for size in (1e-4, 0.01, 0.3):
        for _ in range(15):
            start = rng.uniform(chain.lower, chain.upper)
            points = start + size * np.cumsum(rng.normal(size=(12, chain.dof)), axis=0)
            points = np.clip(points, chain.lower, chain.upper).reshape(2, 6, chain.dof)
            vertices = rng.uniform(-0.1, 0.1, (7, 3))
            T = chain.forward(points[-1, -1])
            placed = vertices @ T[:3, :3].T + T[:3, 3]
            bound = greatest_stray(chain, points, StraightLines(vertices, placed))
            seen = sampled_stray(chain, points, vertices, placed)
            assert seen - 1e-9 <= bound <= seen + 3.0 * straight_down._CHORD_DEVIATION_M
