"""Cells that are ruled out hold nothing, and a search of which nothing is left says so and why."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.contacts.placed_cells import PlacedCells
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.sample_goals.remainder import Remainder
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.search.cell_layout import CELL, PoseSets
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.search.uniform import UniformPoses

CASE = Case("cabinet_low_clutter", "large_crayons_box", "maximize_clearance")


@pytest.fixture(scope="module")
def cabinet():
    return problem_of(CASE)


def hierarchy(problem) -> AfrHierarchy:
    return AfrHierarchy(
        [1], len(problem.body.faces), problem.environment.regions, PlannerSettings().hierarchy
    )


def tip_poses(robot, q_rest, arm, Q):
    """T_world_tip (SE3) at each of Q (n, dof), by pinocchio."""
    data, tip, q = robot.model.createData(), robot.frame_id(arm.tip_frame), q_rest.copy()
    for x in Q:
        q[arm.q_index] = x
        pin.forwardKinematics(robot.model, data, q)
        yield pin.SE3(pin.updateFramePlacement(robot.model, data, tip))


def cell_around(face, contact, angle, rng):
    """A cell of random size that holds that contact and angle, somewhere."""
    size = rng.choice([0.0, 0.03, 0.3]) * rng.random(2)
    turn = rng.choice([0.0, 0.1, 1.0, 1.0]) * rng.uniform(0.0, 2.0 * np.pi)
    low = np.array([*contact[:2], angle]) - rng.random(3) * [*size, turn]
    return face, low, low + np.array([*size, turn])


def test_no_cell_is_out_of_reach_that_some_configuration_reaches(cabinet):
    """Objects as pinocchio puts them, each on a face of its own, with the arms stretched out."""
    problem, objective = cabinet
    rng = np.random.default_rng(4)
    faces, regions, cells, away = [], [], [], []
    for arm in problem.arms:
        Q = rng.uniform(arm.lower + 0.002, arm.upper - 0.002, (4000, arm.dof))
        tips = list(tip_poses(problem.robot, problem.q_start, arm, Q))
        shoulder = problem.robot.link_pose(problem.q_start, "yumi_body").translation
        far = np.argsort([-np.linalg.norm(T.translation - shoulder) for T in tips])
        for k in (*far[:200], *rng.integers(len(tips), size=100)):
            T = tips[k] * arm.grasps[k % len(arm.grasps)]
            contact, angle = T.act(rng.uniform(-0.1, 0.1, 3)), rng.uniform(0.0, 2.0 * np.pi)
            placed = pin.SE3(pin.utils.rotate("z", angle), contact)
            faces.append(replace(problem.body.faces[0], T_face_object=placed.inverse() * T))
            regions.append(Region(np.array([[0.0, 0.0, 1.0, 1.0]]), contact[2]))
            cells.append(cell_around(len(faces) - 1, contact, angle, rng))
            outward = contact[:2] - shoulder[:2]
            at = np.array([*(contact[:2] + outward / np.linalg.norm(outward)), angle])
            away.append((len(faces) - 1, at, at))
    standing = replace(problem, body=replace(problem.body, faces=tuple(faces)))
    planner = PlacementPlanner(standing, objective, PlannerSettings(), np.random.default_rng(0))
    reach = planner._bounds._reach  # at heights where nothing else is known
    sets = PoseSets(regions, [(k, k, 0.0, 1.0) for k in range(600)], [0j] * 600)
    assert not reach.out_of_reach(PlacedCells(sets, np.array(cells, CELL))).any()
    # A metre further out there is nothing but the bound to tell.
    assert reach.out_of_reach(PlacedCells(sets, np.array(away, CELL))).mean() > 0.9


class Treasures:
    """Nothing is possible but at a few poses; a cell is open where it holds one of them."""

    bounded, turn_radius = False, 0.1

    def __init__(self, problem, rng, count) -> None:
        self.at, self.place = UniformPoses(hierarchy(problem), rng).draw(count)

    def rulings(self, cells):
        here = cells["set"][:, None] == self.at
        here &= (cells["low"][:, None] <= self.place).all(axis=-1)
        here &= (cells["high"][:, None] >= self.place).all(axis=-1)
        return np.where(here.any(axis=1), Ruling.OPEN, Ruling.UNSUPPORTED)


@pytest.mark.parametrize("count", [0, 1, 2, 40])
def test_something_is_left_as_long_as_one_pose_is_possible(cabinet, count):
    for seed in range(5):
        treasures = Treasures(cabinet[0], np.random.default_rng(seed), count)
        remainder = Remainder(hierarchy(cabinet[0]), treasures)
        assert any(remainder.empty() for _ in range(100)) == (count == 0)
