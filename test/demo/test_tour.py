"""The tour: the node is told of each thing, and of where each came to stand, and what is left."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from PIL import Image
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

pytest.importorskip("mujoco")

import placement_planner_ros
from placement_planner_ros.client import Validity
from placement_planner_ros.demo import command, results, tour, tour_results
from placement_planner_ros.demo.errors import DemoError
from placement_planner_ros.demo.physics import carrying_out
from placement_planner_ros.demo.search import Found
from placement_planner_ros.demo.setting import TOUR, bundled
from placement_planner_ros.pictures import animation, picture, stage_set
from placement_planner_ros.progress import ProgressLine
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.yumi import start_configuration, yumi_arm

NAMES, SIDES = TOUR[:2], ("left", "right")
LOWERED = 0.1
"""rad that one joint of each arm turns while it carries."""


def solution_of(robot, name, side):
    """A short way of one arm, to a place in the air."""
    held = object_by_name(name)
    arm = yumi_arm(robot, side, held.grasps[side])
    q = robot.configuration(start_configuration(name))
    ends = np.stack([q[arm.q_index], q[arm.q_index] + LOWERED * np.eye(arm.dof)[2]])
    points = [
        JointTrajectoryPoint(
            positions=ends[i].tolist(),
            velocities=[0.0] * arm.dof,
            accelerations=[0.0] * arm.dof,
            time_from_start=Duration(nanosec=300_000_000 * i),
        )
        for i in range(2)
    ]
    reached = robot.with_positions(q, dict(zip(arm.joints, ends[1], strict=True)))
    T = robot.link_pose(reached, arm.tip_frame) * arm.grasps[0]
    x, y, z, *turn = pin.SE3ToXYZQUAT(T).tolist()
    quaternion = Quaternion(**dict(zip("xyzw", turn, strict=True)))
    return SimpleNamespace(
        run=17,
        number=1,
        search_time=0.25,
        arm=side,
        grasp=0,
        approach_start=0.2,
        pose=PoseStamped(pose=Pose(position=Point(x=x, y=y, z=z), orientation=quaternion)),
        trajectory=JointTrajectory(joint_names=list(arm.joints), points=points),
        retreat_trajectory=None,
    )


class Node:
    """A client, a publisher and a node's parameters, all of which remember what they hear."""

    def __init__(self):
        self.confirmed, self.shown, self.told = [], [], []
        self.validity_of = Validity()

    def validity(self, solution):
        return self.validity_of

    def confirm_placed(self, solution, pose):
        self.confirmed.append((solution, pose))

    def wait_until_ready(self, seconds):
        pass

    def show(self, positions, at_rest):
        self.shown.append((positions, at_rest))

    def set_parameters_atomically(self, parameters):
        self.told.append({each.name: each.value for each in parameters})
        result = SimpleNamespace(result=SimpleNamespace(successful=True, reason=""))
        return SimpleNamespace(done=lambda: True, result=lambda: result)


@pytest.fixture(scope="module")
def setting():
    return bundled("cabinet_low_clutter", NAMES[0])


def tour_with(setting, node, found, monkeypatch):
    monkeypatch.setattr(tour, "_SHOWN", 0.0)
    monkeypatch.setattr(tour, "AsyncParameterClient", lambda publisher, name: node)
    monkeypatch.setattr(tour, "search", lambda *_: Found([found.pop(0)], 1.0))
    return tour.Tour(setting, node, "/planner", node, 1.0, lambda: None, ProgressLine())


@pytest.fixture(scope="module")
def toured(setting):
    """Two things put down into the air, in little time."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        for name in ("_RESTING", "_OPENING", "_LOOKING"):
            monkeypatch.setattr(carrying_out, name, 0.2)
        node = Node()
        found = [solution_of(setting.robot, *each) for each in zip(NAMES, SIDES, strict=True)]
        made = tour_with(setting, node, list(found), monkeypatch)
        for name in NAMES:
            made.put_down(name)
    return SimpleNamespace(tour=made, node=node, solutions=found)


def test_the_node_knows_each_thing_before_it_plans_for_it(toured):
    for name, told in zip(NAMES, toured.node.told, strict=True):
        held = object_by_name(name)
        np.testing.assert_array_equal(told["object.vertices"], held.vertices.ravel())
        np.testing.assert_array_equal(told["object.triangles"], held.triangles.ravel())
        for arm, grasps in held.grasps.items():
            poses = np.reshape(told[f"{arm}.grasps"], (-1, 7))
            for given, T in zip(poses, grasps, strict=True):
                np.testing.assert_allclose(pin.XYZQUATToSE3(given), T, atol=1e-12)


def test_what_is_confirmed_is_where_it_came_to_be_and_not_what_was_planned(toured):
    for stop, (solution, pose), planned in zip(
        toured.tour.stops, toured.node.confirmed, toured.solutions, strict=True
    ):
        assert solution is planned
        ended = stop.looks[-1].places[stop.thing.name]
        np.testing.assert_allclose(pin.XYZQUATToSE3(np.array(pose)), ended, atol=1e-9)
        fallen = planned.pose.pose.position.z - pose[2]
        assert fallen > 0.05  # nothing was there to carry it
        assert stop.outcome.moved == pytest.approx(fallen, rel=0.5)
        assert stop.outcome.off < 1e-3


def test_what_was_put_down_is_there_when_the_next_is(toured):
    first, second = toured.tour.stops
    name = NAMES[0]
    before, after = first.looks[-1].places[name], second.looks[0].places[name]
    np.testing.assert_allclose(after, before, atol=1e-9)
    assert toured.tour.knocked > 0.1  # it goes on falling


def test_the_robot_is_shown_where_it_is_and_begins_each_time_where_it_began(toured, setting):
    at_rest = [positions for positions, at_rest in toured.node.shown if at_rest]
    assert at_rest == [start_configuration(name) for name in NAMES]
    lowest = min(positions["yumi_joint_7_l"] for positions, _ in toured.node.shown)
    highest = max(positions["yumi_joint_7_l"] for positions, _ in toured.node.shown)
    assert highest - lowest == pytest.approx(LOWERED, abs=0.01)
    assert set(toured.node.shown[-1][0]) == set(at_rest[0])


def test_a_way_that_begins_elsewhere_is_not_carried_out(setting, monkeypatch):
    found = solution_of(setting.robot, NAMES[0], "left")
    found.trajectory.points[0].positions[3] += 0.1
    made = tour_with(setting, Node(), [found], monkeypatch)
    with pytest.raises(DemoError, match="from where the robot is no more"):
        made.put_down(NAMES[0])


def test_a_placement_that_does_not_hold_any_more_is_not_carried_out(setting, monkeypatch):
    node = Node()
    node.validity_of = Validity("something stands there now")
    made = tour_with(setting, node, [solution_of(setting.robot, NAMES[0], "left")], monkeypatch)
    with pytest.raises(DemoError, match="something stands there now"):
        made.put_down(NAMES[0])


def test_a_refusal_is_said_in_the_nodes_words(setting, monkeypatch):
    node = Node()
    result = SimpleNamespace(result=SimpleNamespace(successful=False, reason="object.vertices: no"))
    node.set_parameters_atomically = lambda parameters: SimpleNamespace(
        done=lambda: True, result=lambda: result
    )
    with pytest.raises(DemoError, match=r"refuses large_crayons_box: object\.vertices: no"):
        tour_with(setting, node, [], monkeypatch).put_down(NAMES[0])


def test_it_leaves_a_table_a_picture_and_an_animation(toured, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(stage_set, "best_direction", lambda *_: (0.5, 0.6))
    monkeypatch.setattr(animation, "_MOST_FRAMES", 3)
    monkeypatch.setattr(tour_results, "_PICTURE_SIZE", (440, 300))
    for each in (stage_set, picture):
        monkeypatch.setattr(each, "OVERSAMPLING", 1)
    written = tour_results.write_tour(tmp_path, toured.tour, ProgressLine())
    assert [path.name for path, _ in written] == ["tour.png", "tour.gif", "tour.md"]
    said = capsys.readouterr().out
    table = (tmp_path / "tour.md").read_text()
    for stop in toured.tour.stops:
        for text in (said, table):
            (row,) = [line for line in text.splitlines() if stop.name in line]
            assert f"{1000.0 * stop.outcome.moved:.2f}" in row
            assert "yes" in row
    moving = Image.open(tmp_path / "tour.gif")
    assert moving.size == (720, 540)
    assert 6 <= moving.n_frames <= 8


def test_without_mujoco_it_says_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(results, "find_spec", lambda name: None)
    assert command.main(["--tour", "--output", str(tmp_path)]) == 1
    assert "pip install 'placement_planner_ros[tour]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [["--tour", "--object", "mug"], ["--tour", "--params-file", "x"]]
)
def test_what_does_not_go_together_is_refused(arguments, capsys):
    with pytest.raises(SystemExit):
        command.main(arguments)
    assert "--tour" in capsys.readouterr().err


def test_only_what_a_tour_alone_needs_imports_mujoco():
    package = Path(placement_planner_ros.__file__).parent
    texts = {
        path.relative_to(package).with_suffix("").as_posix().replace("/", "."): path.read_text()
        for path in package.rglob("*.py")
    }

    def importing(*modules):
        wants = re.compile(rf"^from placement_planner_ros\.({'|'.join(modules)})[ .]", re.M)
        return {name for name, text in texts.items() if wants.search(text)}

    users = importing(r"demo\.physics")
    direct = {name for name in users if not name.startswith("demo.physics.")}
    assert direct == {"demo.tour"}
    assert importing(*direct) - direct == {"demo.tour_results"}
    assert importing(r"demo\.tour_results") == set()
