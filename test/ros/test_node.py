"""The node with a planner that does as it is told."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Point
from helpers import fakes
from helpers.fakes import FRAME, TABLE, started, values_of
from helpers.snapshots import seen
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh, MeshTriangle
from std_msgs.msg import Header

from placement_planner_ros.core.explanation.explanation import SENSOR, Explanation, Remedy
from placement_planner_ros.core.scene.cloud_agreement import Disagreement
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.ros.run.surroundings import Surroundings, environment_notes
from placement_planner_ros.scenes.objects import object_by_name


def test_everything_missing_is_named_at_once(bench):
    with_nothing = bench(**{"object.vertices": None, "object.triangles": None})
    answer = with_nothing.call("start")
    assert not answer.success
    assert answer.code == "NO_CLOUD"
    named = [line.split(":")[0] for line in answer.words.splitlines()]
    assert named == ["NO_CLOUD", "JOINTS_MISSING", "NO_OBJECT"]


@pytest.mark.parametrize("joints", ["arm", "all"])
def test_parts_come_first_carry_the_key_and_are_withdrawn_by_the_next_run(bench, joints):
    b = bench()
    box = [0.7, 0.7, 0.0, 0.8, 0.8, 0.1]
    planner = started(b, keep_out=box, trajectory_joints=joints)
    planner.retreats = True
    b.heard.clear()
    planner.offers.append(0.25)
    b.wait(b.manifests)
    manifest = b.manifests()[-1]
    assert (manifest["run"], manifest["solution"]) == ("1", "1")
    assert float(manifest["objective"]) == 0.25
    assert (manifest["arm"], manifest["grasp"], manifest["face"]) == ("left", "0", "1")
    assert float(manifest["approach_start"]) == 0.5
    assert manifest["has_retreat"] == "true"
    assert 0.0 < float(manifest["search_time"]) < 60.0
    topics = ("trajectory", "retreat_trajectory", "placement_pose", "objective", "markers")
    b.wait(lambda: all(b.messages(topic) for topic in topics))
    trajectory, retreat, pose = (b.messages(topic)[-1] for topic in topics[:3])
    assert trajectory.header.frame_id == retreat.header.frame_id == "1/1"
    assert (trajectory.header.stamp.sec, trajectory.header.stamp.nanosec) == (0, 0)
    assert pose.header.frame_id == FRAME
    assert pose.header.stamp == b.messages("solution")[-1].header.stamp
    assert b.messages("objective")[-1].data == 0.25
    # The retreat goes on from the trajectory, with the hand open.
    values = dict(zip(retreat.joint_names, retreat.points[0].positions, strict=True))
    for name, value in zip(trajectory.joint_names, trajectory.points[-1].positions, strict=True):
        if name != "gripper_l_joint":
            assert values[name] == value
    assert values.get("gripper_l_joint", 0.025) == 0.025
    # Markers come after the manifest, and those of the scene before those of the placement.
    drawn = {"target_volume", "keep_out", "regions", "object", "contacts", "wall", "path"}
    b.wait(lambda: {m.ns for m in b.messages("markers")[-1].markers} == drawn)
    b.call("stop")
    started(b)
    b.wait(lambda: b.manifests()[-1]["run"] == "2")
    assert b.manifests()[-1]["solution"] == "0"
    b.wait(lambda: b.messages("trajectory")[-1].header.frame_id == "2/0")
    assert b.messages("trajectory")[-1].points == []
    assert b.messages("retreat_trajectory")[-1].header.frame_id == "2/0"
    stamps = [(m.header.stamp.sec, m.header.stamp.nanosec) for m in b.messages("solution")]
    assert stamps == sorted(set(stamps))


def test_status_says_why_nothing_has_been_found_and_what_was_rejected(bench):
    b = bench()
    planner = started(b)
    planner.statistics.rejected = {"unstable": 3}
    planner.explanation = Explanation("it is full", (Remedy(SENSOR, "look again"),), ("4 of 4",))
    b.wait(lambda: b.status()["why"])
    status = b.status()
    assert status["state"] == "searching"
    assert status["why"] == "it is full\ntry sensor_poses.<frame>: look again\n4 of 4"
    assert status["rejected_unstable"] == "3"
    planner.offers.append(0.3)
    b.wait(lambda: b.status()["solutions"] == "1")
    assert b.status()["why"] == ""
    answer = b.call("stop")
    assert answer.words == "stopped: one solution, by arm left; nothing was tried"


def test_stop_with_ends_that_run_only(bench):
    b = bench()
    started(b)
    answer = b.call("stop_with", run=7)
    assert not answer.success
    assert answer.code == "WRONG_RUN"
    assert b.node._commands.run.active
    assert b.call("stop_with", run="1").code == "BAD_PARAMETER"
    assert b.call("stop_with", run=1).code == "OK"
    assert b.call("stop_with", run=1).code == "NOT_RUNNING"


def test_a_worker_that_hangs_is_reported_and_publishes_nothing_more(bench):
    b = bench()
    planner = started(b)
    planner.deaf = True
    answer = b.call("stop")
    assert not answer.success
    assert answer.code == "STOPPING"
    assert b.call("start").code == "STOPPING"
    planner.offers.append(0.5)
    b.wait(lambda: not planner.offers)
    planner.done.set()
    b.wait(lambda: not b.node._commands.run.active)
    assert b.node._commands.run.solutions == 0
    assert b.manifests()[-1]["solution"] == "0"
    b.feed()
    assert b.call("start").run == "2"


def test_start_with_changes_parameters_for_one_run(bench):
    b = bench()
    started(b, objective="minimize_clearance", collision_margin=0)
    assert b.snapshots[-1].parameters["objective"] == "minimize_clearance"
    assert b.snapshots[-1].parameters["collision_margin"] == 0.0
    b.call("stop")
    started(b)
    assert b.snapshots[-1].parameters["objective"] == "maximize_clearance"
    assert b.node.get_parameter("objective").value == "maximize_clearance"


def test_clouds_that_contradict_each_other_are_told_in_the_status(bench, monkeypatch):
    found = (Disagreement("left", "right", 0.015, np.zeros((0, 3))),)
    make = Environment.from_points
    contrary = SimpleNamespace(from_points=lambda *a, **k: make(*a, **k).with_disagreements(found))
    monkeypatch.setattr(fakes, "Environment", contrary)
    b = bench()
    started(b)
    b.wait(lambda: "0.0150 m above left" in b.status().get("clouds_disagree", ""))


def test_bad_parameters_for_a_run_are_refused(bench):
    b = bench()
    b.feed()
    for parameters, code in (
        ({"objective": "the_best"}, "BAD_PARAMETER"),
        ({"no_such": 1}, "BAD_PARAMETER"),
        ({"planning_frame": "map"}, "BAD_PARAMETER"),
        ({"target_volume": [1.0, 0.0, 0.0, 0.0, 1.0, 1.0]}, "BAD_VOLUME"),
        ({"left__grasps": [1.0, 2.0]}, "BAD_GRASP"),
        ({"left__grasps": [], "right__grasps": []}, "BAD_GRASP"),
        ({"object__triangles": [0, 1, 99]}, "BAD_OBJECT"),
        ({"left__tip_frame": "nowhere"}, "BAD_PARAMETER"),
        ({"world_links": ["nowhere"]}, "BAD_PARAMETER"),
        ({"world_links": ["yumi_link_1_l"]}, "BAD_PARAMETER"),  # which moves
        ({"self_filter__padding_of": ["nowhere=0.01"]}, "BAD_PARAMETER"),
        ({"assumed_joints": ["nowhere=0.01"]}, "BAD_PARAMETER"),
        ({"acceleration_limits": [1.0, 2.0]}, "BAD_PARAMETER"),
        ({"carry__max_tilt": 0.2}, "BAD_PARAMETER"),
        ({"carry__max_acceleration": -1.0}, "BAD_PARAMETER"),
        ({"carry__max_tilt": 0.01, "object__up": [0.3, 0.5, 1.0]}, "BAD_START"),
    ):
        answer = b.call("start_with", **parameters)
        assert (answer.success, answer.code) == (False, code), answer.text
    assert b.node._commands.run is None


def test_every_fault_has_a_line(bench):
    b = bench()
    b.feed()
    changes = {"seed": -5, "sampler": "magic", "left__grasps": [1.0], "no_such": 1}
    words = b.call("start_with", **changes).words.splitlines()
    assert sorted(line.split(" ")[1] for line in words) == [
        "left.grasps",
        "no_such",
        "sampler",
        "seed",
    ]
    words = b.call("start_with", left__tip_frame="a", right__tip_frame="b").words.splitlines()
    assert len(words) == 2
    assert "arm left" in words[0]
    assert "arm right" in words[1]


def test_inputs_that_are_wrong_are_told_apart(bench):
    b = bench()
    b.feed()
    b.joint_state(yumi_joint_5_l=0.2)
    b.wait(lambda: b.node._inputs.joints.positions()["yumi_joint_5_l"] == 0.2)
    assert b.call("start").code == "ROBOT_MOVING"
    b.cloud(frame="")
    b.wait(lambda: b.call("start").code == "CLOUD_FRAME")
    b.cloud(frame="camera_nobody_knows")
    b.wait(lambda: "camera_nobody_knows" in b.call("start").text)
    b.wait(lambda: "JOINTS_STALE" in b.call("start_with", joint_state_timeout=0.05).text)


def test_a_cloud_is_moved_from_its_sensor_to_the_planning_frame(bench):
    half = np.sqrt(0.5)
    b = bench(sensor_frames=["eye"], **{"cloud.max_age": 0})
    pose = [0.0, 0.0, 0.1, 0.0, 0.0, half, half]
    b.cloud(TABLE, frame="eye")
    b.wait(lambda: "eye" in b.call("start").text, again=lambda: b.cloud(TABLE, frame="eye"))
    # The cloud has waited for the pose of its frame.
    assert b.node.set_parameters([Parameter("sensor_poses.eye", value=pose)])[0].successful
    b.wait(lambda: b.call("start").success, again=b.joint_state)
    b.wait(lambda: b.snapshots)
    expected = np.column_stack([-TABLE[:, 1], TABLE[:, 0], TABLE[:, 2] + 0.1])
    np.testing.assert_allclose(np.vstack(b.snapshots[0].clouds), expected, atol=1e-6)


def test_unknown_space_is_obstacle_where_asked_for_and_the_sensor_is_known(bench):
    b = bench(sensor_frames=["eye"], **{"cloud.max_age": 0, "unknown_space": "occupied"})
    b.feed()
    assert "no effect" in b.call("start").text
    b.wait(lambda: b.snapshots)
    assert b.snapshots[0].parts[0].origin is None
    assert b.call("stop").success
    pose = [0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0]
    assert b.node.set_parameters([Parameter("sensor_poses.eye", value=pose)])[0].successful
    updates = b.node._inputs.clouds.updates
    b.cloud(TABLE - [0.0, 0.0, 0.8], frame="eye")
    b.wait(lambda: b.node._inputs.clouds.updates > updates)
    b.joint_state()
    said = b.call("start")
    assert said.success
    assert "no effect" not in said.text
    b.wait(lambda: len(b.snapshots) == 2)
    snapshot = b.snapshots[1]
    assert snapshot.parts[0].origin.tolist() == [0.0, 0.0, 0.8]
    careful = Surroundings.of(snapshot).environment()
    assert 0.0 < careful.seen < 1.0
    assert not environment_notes(snapshot, careful)


def test_reliability_follows_the_publishers(bench):
    b = bench()
    subscriptions = b.node._reception.clouds
    b.wait(lambda: subscriptions._subscriptions["points"][0] is ReliabilityPolicy.RELIABLE)
    loose = b.client.create_publisher(
        PointCloud2, "points", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    )
    b.wait(lambda: subscriptions._subscriptions["points"][0] is ReliabilityPolicy.BEST_EFFORT)
    message = message_from_points(TABLE[:7], Header(frame_id=FRAME))
    clouds = b.node._inputs.clouds
    b.wait(
        lambda: any(len(c.points) == 7 for c in clouds.latest().values()),
        again=lambda: loose.publish(message),
    )
    b.client.destroy_publisher(loose)
    b.wait(lambda: subscriptions._subscriptions["points"][0] is ReliabilityPolicy.RELIABLE)
    b.feed()


def test_a_confirmed_object_is_not_filtered_as_held(bench):
    b = bench()
    started(b)
    snapshot = b.snapshots[-1]
    T_world_tip = snapshot.robot.link_pose(snapshot.q_start, "gripper_l_base")
    inside = np.array([(T_world_tip * snapshot.arms[0].grasps[0]).translation])
    clouds = (TABLE, np.repeat(inside, 50, axis=0))
    for placed in (False, True):
        both = seen(snapshot, clouds, (None, None), (False, placed))
        made = Surroundings.of(both).environment()
        boxes = made.obstacles
        near = np.abs((boxes.lower + boxes.upper) / 2 - inside).max(axis=1) < 0.02
        assert near.any() == placed


def test_the_newest_object_wins_be_it_a_topic_or_a_parameter(bench):
    b = bench()
    publisher = b.client.create_publisher(Mesh, "placement_planner/object", LATCHED)
    held = object_by_name("large_crayons_box")
    corners = [Point(x=x, y=y, z=z) for x, y, z in held.vertices.tolist()]
    triangles = [MeshTriangle(vertex_indices=t.astype(np.uint32)) for t in held.triangles]
    publisher.publish(Mesh(vertices=corners, triangles=triangles))
    b.wait(lambda: b.node._inputs.object._topic is not None)
    started(b)
    np.testing.assert_array_equal(b.snapshots[-1].body.vertices, held.vertices)
    b.call("stop")
    again = b.node.get_parameter("object.vertices")
    assert b.node.set_parameters([again])[0].successful
    started(b)
    small = np.reshape(again.value, (-1, 3))
    np.testing.assert_array_equal(b.snapshots[-1].body.vertices, small)


def test_a_run_waits_for_compilation_and_its_time_does_not_count(bench):
    b = bench(warm=False)
    b.feed()
    assert b.call("start").success
    assert b.call("stop").code == "OK"
    assert b.call("start_with", time_limit=0.1).success
    b.wait(lambda: b.status()["state"] == "preparing")
    compiled = time.monotonic()
    b.node._warm.set()
    b.wait(lambda: b.status()["state"] == "time_limit")
    assert b.node._commands.run._deadline >= compiled + 0.1


def test_diagnostics_tell_the_ages_of_inputs(bench):
    b = bench()
    b.feed()
    b.wait(
        lambda: (
            b.messages("diagnostics")
            and "cloud_age points" in values_of(b.messages("diagnostics")[-1].status[0])
        )
    )
    assert values_of(b.messages("diagnostics")[-1].status[0])["state"] == "idle"
