"""How far a camera is off, by the robot that it shows; what stands beside is no robot for that."""

import numpy as np
import pytest
import trimesh
from helpers.fakes import TABLE
from helpers.snapshots import yumi_snapshot

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.pictures.shapes import RobotShapes
from placement_planner_ros.ros.inputs.camera_shift import camera_shift
from placement_planner_ros.ros.inputs.self_filter import Outline
from placement_planner_ros.ros.run.preparation import make_planner
from placement_planner_ros.ros.run.surroundings import Surroundings
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi

ROBOT = load_yumi()
Q = ROBOT.configuration(START_CONFIGURATION)
OUTLINE = Outline.of_robot(ROBOT, Q, 0.02)
EYE = np.array([0.8, -0.9, 0.9])


def seen(shift, deviation=0.001, links=None):
    """Points on what of the robot faces the eye."""
    found = []
    for number, mesh in enumerate(RobotShapes(ROBOT).at(Q)):
        if links is not None and ROBOT.geometry_links[number] not in links:
            continue
        made = trimesh.Trimesh(**trimesh.triangles.to_kwargs(mesh.corners), process=False)
        points, faces = trimesh.sample.sample_surface(made, int(made.area / 2e-5), seed=number)
        facing = np.einsum("ij,ij->i", made.face_normals[faces], EYE - points) > 0.0
        found.append(points[facing])
    points = np.vstack(found)
    points = points[OUTLINE.look(points).apart < 1e-6]  # not those within another link
    return points + shift + np.random.default_rng(0).normal(0.0, deviation, points.shape)


@pytest.mark.parametrize(
    "shift", [(0.0035, 0.0, 0.0), (0.0, -0.003, 0.003), (-0.002, 0.002, -0.003)]
)
def test_an_ordinary_calibration_is_known_by_the_robot(shift):
    assert camera_shift(OUTLINE, seen(shift)) == pytest.approx(np.array(shift), abs=6e-4)


def test_it_is_known_by_round_links_too():
    shape = '<geometry><sphere radius="0.1"/></geometry>'
    ball = Robot.from_urdf(
        f'<robot name="b"><link name="l"><collision>{shape}</collision></link></robot>'
    )
    points = np.random.default_rng(0).normal(size=(4000, 3))
    points *= 0.1 / np.linalg.norm(points, axis=1)[:, None]
    shift = np.array([0.004, 0.0, 0.0])
    outline = Outline.of_robot(ball, np.zeros(0), 0.02)
    assert camera_shift(outline, points[points[:, 0] > -0.05] + shift) == pytest.approx(
        shift, abs=6e-4
    )


def test_what_is_true_or_off_by_more_is_left_as_it_is():
    assert not camera_shift(OUTLINE, seen(0.0)).any()
    assert not camera_shift(OUTLINE, seen((0.0, 0.0, 0.015))).any()
    assert not camera_shift(OUTLINE, np.zeros((0, 3))).any()


def test_a_board_beside_the_arm_is_not_its_surface():
    """It hides all that it is in front of, and is nearer than a camera may be off."""
    body = seen(0.0, 0.0, links=["yumi_body"])
    flat = body[np.abs(body[:, 0] - body[:, 0].max()) < 0.03]
    assert len(flat)
    board = flat * (0.0, 1.0, 1.0) + (body[:, 0].max() + 0.004, 0.0, 0.0)
    assert not camera_shift(OUTLINE, board).any()
    assert not camera_shift(OUTLINE, np.vstack([seen(0.0), board])).any()


@pytest.mark.parametrize(("shift", "error"), [((0.0035, 0.0, 0.0), 0.0035), (0.0, 0.0)])
def test_motions_keep_as_much_more_from_what_may_be_off(shift, error):
    snapshot = yumi_snapshot(("left",), (np.vstack([TABLE, seen(shift)]),))
    planner = make_planner(snapshot, Surroundings.of(snapshot).environment())
    holding, *_ = planner.holdings.values()
    kept = holding.collision.settings.obstacle_margin
    assert kept == pytest.approx(0.003 + error, abs=6e-4)
