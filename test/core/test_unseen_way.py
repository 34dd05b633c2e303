"""Motions through a shelf's board of which the camera saw the front edge only."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.cases import build_problem, inputs_of
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.freespace import SeenSpace, View
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.timing.quintic import positions_at
from placement_planner_ros.core.types import TargetVolume, Trajectory
from placement_planner_ros.core.unseen_way import unseen_share
from placement_planner_ros.ros.run.surroundings import environment_notes
from placement_planner_ros.scenes.clouds import CameraNoise, DepthCamera, camera_clouds
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.primitives import box
from placement_planner_ros.scenes.scenes import Scene
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm

GREY = (0.5, 0.5, 0.5)
X0, X1, Y = 0.42, 0.72, 0.3
FLOOR, BOARD, THICK = 0.05, 0.37, 0.02
VOLUME = TargetVolume([X0 + 0.02, -Y + 0.05, FLOOR - 0.02], [X1 - 0.03, Y - 0.05, FLOOR + 0.2])


def shelf(board=True, eye=(0.0, 0.0, BOARD + 0.01)):
    """What a camera sees of a compartment; at the board's own height its front edge alone."""
    parts = [
        box("floor", (X0, -Y, FLOOR - 0.02), (X1, Y, FLOOR), GREY),
        box("left", (X0, Y, FLOOR - 0.02), (X1, Y + THICK, BOARD), GREY),
        box("right", (X0, -Y - THICK, FLOOR - 0.02), (X1, -Y, BOARD), GREY),
        box("back", (X1, -Y - THICK, FLOOR - 0.02), (X1 + THICK, Y + THICK, BOARD + 0.3), GREY),
    ]
    if board:
        parts.append(box("board", (X0, -Y, BOARD), (X1, Y, BOARD + THICK), GREY))
    camera = DepthCamera.looking_at("eye", np.array(eye), (0.6, 0.0, FLOOR + 0.12))
    (cloud,) = camera_clouds(
        Scene("shelf", VOLUME, tuple(parts)),
        np.random.default_rng(0),
        cameras=[camera],
        noise=CameraNoise(0.001, 0.0),
    )
    return View(cloud.world_points().reshape(-1, 3), np.array(eye))


def of_shelf(view):
    return Environment.from_points(view.points, VOLUME, sights=[view])


def test_a_board_seen_from_the_front_is_a_ceiling_that_nobody_saw():
    assert of_shelf(shelf()).has_unseen_ceiling


def test_a_ceiling_that_was_seen_or_is_not_there_is_none():
    assert not of_shelf(shelf(board=False)).has_unseen_ceiling
    assert not of_shelf(shelf(eye=(0.0, 0.0, 0.15))).has_unseen_ceiling
    assert not Environment.from_points(shelf().points, VOLUME).has_unseen_ceiling


def cuts_the_board(inputs, placement):
    """Whether the held object is within the board somewhere on the way."""
    arm = next(each for each in inputs.arms if each.name == placement.arm)
    path = placement.trajectory
    low, high = (X0, -Y, BOARD), (X1, Y, BOARD + THICK)
    q = inputs.q_start.copy()
    for at in positions_at(path, np.linspace(path.times[0], path.times[-1], 200)):
        q[arm.q_index] = at
        T = inputs.robot.link_pose(q, arm.tip_frame) * arm.grasps[placement.grasp]
        points = inputs.body.volume_points @ T.rotation.T + T.translation
        if ((points > low) & (points < high)).all(axis=1).any():
            return True
    return False


def first_placements(problem, objective):
    """Of one seed after the other."""
    for seed in range(8, 16):
        rng = np.random.default_rng(seed)
        planner = PlacementPlanner(problem, objective, PlannerSettings(), rng)
        yield next(planner.run(lambda planner=planner: planner.statistics.samples > 10**6))


def test_planned_motions_that_cut_the_board_are_told_of_with_the_remedy_which_spares_it():
    view = shelf()
    inputs = inputs_of("small_crayons_box", VOLUME, view.points)
    problem, objective = build_problem(inputs, "maximize_clearance", sights=[view])
    placed = first_placements(problem, objective)
    cut = [each.unseen for each in placed if cuts_the_board(inputs, each)]
    assert cut  # the shortest ways from above the board lead through it
    assert min(cut) > 0.0
    below = replace(problem, environment=problem.environment.with_unknown(below_measured=True))
    spared = list(first_placements(below, objective))
    assert len(spared) == 8
    assert not any(cuts_the_board(inputs, each) for each in spared)
    parameters = {"unknown_space": "free", "contact_tolerance": 0.003}
    asked = SimpleNamespace(parameters=parameters, parts=())
    (note,) = environment_notes(asked, problem.environment)
    assert "unknown_space to occupied_below, or keep_out" in note


@pytest.fixture(scope="module")
def lifting():
    """The YuMi with an object in its left hand, which a turn of one joint moves upwards."""
    robot, held = load_yumi(), object_by_name("small_crayons_box")
    arm = yumi_arm(robot, "left", held.grasps["left"])
    q = robot.configuration(START_CONFIGURATION)
    body = Body.from_mesh(held.vertices, held.triangles, held.center_of_mass)

    def height(joint, by):
        moved = q.copy()
        moved[arm.q_index[joint]] += by
        return (robot.link_pose(moved, arm.tip_frame) * arm.grasps[0]).translation

    joint = max(range(len(arm.joints)), key=lambda j: height(j, 0.5)[2] - height(j, 0.0)[2])
    turn = np.zeros((2, len(arm.joints)))
    turn[1, joint] = 0.5
    still = np.zeros_like(turn)
    path = Trajectory(arm.joints, np.array([0.0, 2.0]), q[arm.q_index] + turn, still, still)
    return robot, q, arm, body, path, height(joint, 0.3)


def seen_past(at, blocked):
    """A sensor on the far side that sees all around a place but what a board hides."""
    eye = at + np.array([1.5, 0.0, 0.0])
    ticks = np.arange(-0.8, 0.8, 0.004)
    wall = np.stack(np.meshgrid([-0.7], ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3) + at
    # rays that would pass the board end at its edge
    front = eye + (wall - eye) * ((eye[0] - at[0] - 0.3) / (eye[0] - wall[:, :1]))
    ends = np.where((np.abs(front[:, 2] - blocked) < 0.01)[:, None], front, wall)
    volume = TargetVolume(at - 0.1, at + 0.1)
    obstacles = ObstacleSet.from_points(ends, bounds=(at - 1.0, at + 1.0))
    return SeenSpace.around(obstacles, [View(ends, eye)], volume, at - 1.0, at + 1.0)


def share_of(space, lifting, path):
    robot, q, arm, body, *_ = lifting
    around = SimpleNamespace(seen_space=space)
    problem = SimpleNamespace(robot=robot, q_start=q, body=body, environment=around)
    return unseen_share(problem, arm, 0, path, None)


def test_only_a_motion_that_cuts_the_board_has_a_share_unseen(lifting):
    *_, path, middle = lifting
    through = seen_past(middle, middle[2])
    share = share_of(through, lifting, path)
    assert 0.001 < share < 0.5
    beside = seen_past(middle, middle[2] + 0.45)
    assert share_of(beside, lifting, path) == 0.0


def test_where_the_robot_is_at_the_start_is_not_unseen(lifting):
    robot, q, arm, _, path, _ = lifting
    start = (robot.link_pose(q, arm.tip_frame) * arm.grasps[0]).translation
    space = seen_past(start, start[2])
    times, zero = np.array([0.0, 1.0]), np.zeros((2, len(arm.joints)))
    hold = Trajectory(arm.joints, times, np.tile(q[arm.q_index], (2, 1)), zero, zero)
    assert share_of(space, lifting, hold) == 0.0
    assert share_of(space, lifting, path) < 0.2
