"""Inverse kinematics: tolerances and limits of all that is returned, success, straight lines."""

import math

import numpy as np
import pinocchio as pin
import pytest
from helpers.few_joints import urdf_of
from helpers.shared import SHARED

from placement_planner_ros.core.reach.ik import IKSettings, InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.reach.seeds import SeedTable
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm

PANDA = SHARED / "data/robots/panda_description/urdf/panda_collision.urdf"


def chain_of(name: str) -> Chain:
    if name == "scara":
        robot = Robot.from_urdf(urdf_of(name))
        return Chain.from_robot(robot, robot.arm("arm", "tip"), np.zeros(robot.model.nq))
    if name == "panda":
        if not PANDA.is_file():
            pytest.skip("needs the shared Panda")
        robot = Robot.from_urdf(PANDA.read_text(encoding="utf-8"))
        return Chain.from_robot(robot, robot.arm("arm", "panda_hand"), np.zeros(robot.model.nq))
    robot = load_yumi()
    q_rest = robot.configuration(START_CONFIGURATION)
    return Chain.from_robot(robot, yumi_arm(robot, name), q_rest)


@pytest.fixture(scope="module", params=["left", "right"])
def yumi_chain(request) -> Chain:
    return chain_of(request.param)


@pytest.fixture(scope="module")
def scara_chain() -> Chain:
    return chain_of("scara")


def pose_errors(T: np.ndarray, wanted: np.ndarray) -> tuple[float, float]:
    """Metres and radians between two (4, 4) poses."""
    turn = pin.log3(wanted[:3, :3].T @ T[:3, :3])
    return float(np.linalg.norm(T[:3, 3] - wanted[:3, 3])), float(np.linalg.norm(turn))


def assert_solutions(chain: Chain, settings: IKSettings, T: np.ndarray, Q: np.ndarray) -> None:
    assert (chain.lower <= Q).all()
    assert (chain.upper >= Q).all()
    for q in Q:
        position, rotation = pose_errors(chain.forward(q), T)
        assert position <= settings.position_tolerance * (1 + 1e-6)
        assert rotation <= settings.rotation_tolerance * (1 + 1e-6)


def test_poses_of_random_configurations_are_solved(yumi_chain):
    rng = np.random.default_rng(3)
    settings = IKSettings(max_solutions=4)
    ik = InverseKinematics(yumi_chain, settings)
    table = SeedTable(yumi_chain, rng)
    T = yumi_chain.forward_batch(yumi_chain.random(rng, (1000,)))
    found = [ik.solve(*each) for each in zip(T, table.near(T, 16, rng), strict=True)]
    assert np.mean([len(Q) > 0 for Q in found]) >= 0.99
    for pose, Q in zip(T, found, strict=True):
        assert_solutions(yumi_chain, settings, pose, Q)


def apart(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of a joint, full turns aside."""
    return float(np.abs((a - b + math.pi) % (2 * math.pi) - math.pi).max())


@pytest.mark.parametrize("name", ["left", "right", "panda"])
def test_sweep_is_sound_distinct_and_repeatable(name):
    chain = chain_of(name)
    rng = np.random.default_rng(11)
    ik = InverseKinematics(chain)
    given = swept = 0
    for pose in chain.forward_batch(chain.random(rng, (40,))):
        solutions = ik.solve(pose, chain.random(rng, (8,)))
        Q = ik.sweep(pose, solutions)
        assert np.array_equal(Q, ik.sweep(pose, solutions))
        assert_solutions(chain, ik.settings, pose, Q)
        for k in range(len(Q)):
            assert all(apart(Q[k], other) > 0.1 * ik.settings.sweep_step for other in Q[:k])
        given, swept = given + len(solutions), swept + len(Q)
    assert swept > 4 * given


def test_sliding_joint_and_fewer_than_six_joints(scara_chain):
    rng = np.random.default_rng(6)
    ik = InverseKinematics(scara_chain)
    T = scara_chain.forward_batch(scara_chain.random(rng, (200,)))
    found = [ik.solve(pose, scara_chain.random(rng, (16,))) for pose in T]
    assert np.mean([len(Q) > 0 for Q in found]) >= 0.99
    for pose, Q in zip(T, found, strict=True):
        assert_solutions(scara_chain, ik.settings, pose, Q)
    tilted = T[0].copy()
    tilted[:3, :3] = tilted[:3, :3] @ pin.rpy.rpyToMatrix(0.1, 0.0, 0.0)
    assert len(ik.solve(tilted, ik.chain.random(rng, (32,)))) == 0


def line(T: np.ndarray, offset: np.ndarray, count: int) -> np.ndarray:
    poses = np.tile(T, (count, 1, 1))
    poses[:, :3, 3] += np.linspace(0.0, 1.0, count)[:, None] * offset
    return poses


def test_track_follows_straight_lines(yumi_chain):
    rng = np.random.default_rng(9)
    ik = InverseKinematics(yumi_chain)
    tracked = 0
    for q in ik.chain.random(rng, (60,)):
        poses = line(yumi_chain.forward(q), np.array([0.0, 0.0, 0.04]), 9)
        path = ik.track(poses, q)
        if path is None:
            continue
        tracked += 1
        assert np.abs(np.diff(path, axis=0)).max() <= ik.settings.max_joint_step
        for T, x in zip(poses, path, strict=True):
            assert_solutions(yumi_chain, ik.settings, T, x[None])
        for a, b, T_a, T_b in zip(path[:-1], path[1:], poses[:-1], poses[1:], strict=True):
            middle = yumi_chain.forward(0.5 * (a + b))
            wanted = T_a.copy()
            wanted[:3, 3] = 0.5 * (T_a + T_b)[:3, 3]
            position, rotation = pose_errors(middle, wanted)
            assert max(position, rotation) <= 1.01 * ik.settings.line_tolerance
    assert tracked >= 25


def test_poses_that_are_not_numbers_have_no_solution(yumi_chain):
    ik = InverseKinematics(yumi_chain)
    T = np.full((4, 4), np.nan)
    assert len(ik.solve(T, ik.chain.random(np.random.default_rng(0), (4,)))) == 0
