"""OptimizeLocally on a planar robot whose joints are x, y and the angle of the object."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from placement_planner_ros.core.grasp.holding import PlacingMotion
from placement_planner_ros.core.objective.ascent import AscentSettings
from placement_planner_ros.core.objective.objective import moved_pose, objective_gradient
from placement_planner_ros.core.optimize_locally import LocalOptimizer
from placement_planner_ros.core.types import Goal, Verdict


def yaw(T: pin.SE3) -> float:
    return float(np.arctan2(T.rotation[1, 0], T.rotation[0, 0]))


class PlanarReach:
    """q = (x, y, e_z); everything but x > limit is reachable."""

    any_turn = None

    def __init__(self, x_limit: float = np.inf, blocked=lambda a, b: False) -> None:
        self.arm = SimpleNamespace(
            grasps=(pin.SE3.Identity(),), lower=np.full(3, -10.0), upper=np.full(3, 10.0)
        )
        jacobian = np.zeros((6, 3))
        jacobian[0, 0] = jacobian[1, 1] = jacobian[5, 2] = 1.0
        self.chain = SimpleNamespace(jacobian=lambda q, grasp: jacobian)
        self.x_limit = x_limit
        self.transit_free = lambda a, b: not blocked(a, b)

    def follow(self, T, q):
        goal = np.array([T.translation[0], T.translation[1], yaw(T)])
        assert np.allclose(q, goal, atol=1e-9), "the Jacobian step should predict the pose"
        return goal if goal[0] <= self.x_limit else None

    def placing_motion(self, q, T, contact, poses):
        return PlacingMotion(np.array([q, q]), None, (0.0, 0.0, 1.0))


def free_where(verdict):
    """Constraints of which the verdict is all that matters."""
    moved = SimpleNamespace(moved=lambda T, contact, change: moved_pose(T, change))
    return SimpleNamespace(verdict=verdict, contacts=moved)


class Bowl:
    """ξ with its maximum at (0.3, 0.2, 0.5), steeper in y than in x."""

    def __call__(self, T) -> float:
        x, y, _ = T.translation
        return float(-((x - 0.3) ** 2) - 4 * (y - 0.2) ** 2 - 0.1 * (yaw(T) - 0.5) ** 2)


def optimize(poses=None, holding=None, objective=None, should_stop=lambda: False, **settings):
    poses = poses or free_where(lambda T, contact: Verdict.FEASIBLE)
    objective = objective or Bowl()
    start = pin.SE3.Identity()
    goal = Goal("a", 0, 0, start, 0.0, np.zeros((2, 3)), objective(start))
    optimizer = LocalOptimizer(poses, objective, 1e-9, AscentSettings(**settings))
    return optimizer.optimize(goal, holding or PlanarReach(), should_stop)


def test_climbs_to_the_optimum():
    refined, _ = optimize(max_steps=400, last_step=1e-5)
    assert refined.T_world_object.translation == pytest.approx([0.3, 0.2, 0.0], abs=2e-3)
    assert yaw(refined.T_world_object) == pytest.approx(0.5, abs=0.05)
    assert refined.objective == Bowl()(refined.T_world_object)


def test_slides_along_a_wall_that_blocks_the_gradient():
    poses = free_where(
        lambda T, contact: Verdict.FEASIBLE if T.translation[0] <= 0.1 else Verdict.COLLIDING
    )
    refined, _ = optimize(poses=poses, max_steps=400, last_step=1e-5)
    x, y, _ = refined.T_world_object.translation
    assert x <= 0.1
    assert x == pytest.approx(0.1, abs=2e-3)
    assert y == pytest.approx(0.2, abs=2e-3)


def test_never_leaves_what_the_arm_can_reach_or_cross_a_blocked_edge():
    refined, _ = optimize(holding=PlanarReach(x_limit=0.15))
    assert refined.T_world_object.translation[0] <= 0.15
    refined, slide = optimize(holding=PlanarReach(blocked=lambda a, b: True))
    assert refined.T_world_object.translation == pytest.approx([0, 0, 0])
    assert len(slide) == 1


def test_numerical_gradient_matches_the_analytic_one_of_a_black_box():
    T = moved_pose(pin.SE3.Identity(), np.array([0.1, 0.05, 0.2]))
    expected = [-2 * (0.1 - 0.3), -8 * (0.05 - 0.2), -0.2 * (0.2 - 0.5)]
    assert objective_gradient(Bowl(), T) == pytest.approx(expected, abs=1e-6)


def test_on_a_slope_poses_are_moved_within_its_plane():
    """All points of the object keep their distance from it; differences are taken along it too."""
    slope = (0.1, -0.05)
    normal = np.array([-0.1, 0.05, 1.0])
    rng = np.random.default_rng(0)
    points = rng.normal(size=(20, 3))
    for _ in range(20):
        T, change = pin.SE3.Random(), rng.normal(size=3)
        there = moved_pose(T, change, slope)
        before = (points @ T.rotation.T + T.translation) @ normal
        assert (points @ there.rotation.T + there.translation) @ normal == pytest.approx(before)
        assert (there.translation - T.translation)[:2] == pytest.approx(change[:2])
        turn = pin.log3(there.rotation @ T.rotation.T)
        assert np.cross(turn, normal) == pytest.approx(np.zeros(3), abs=1e-9)
    assert objective_gradient(lambda T: T.translation[2], T, slope=slope) == pytest.approx(
        [*slope, 0.0]
    )
    assert objective_gradient(lambda T: T.translation[2], T) == pytest.approx(np.zeros(3))
