"""`best_valid`: what makes it false, with which words, and what does not."""

import threading

import numpy as np
import pytest
from geometry_msgs.msg import Point
from helpers.fakes import FRAME, TABLE, started, values_of
from helpers.home import HOME
from rclpy.parameter import Parameter
from shape_msgs.msg import Mesh, MeshTriangle
from std_msgs.msg import Header, String

from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.ros.run import watch
from placement_planner_ros.scenes.objects import object_by_name


def placed(bench, retreats=False, **parameters):
    """A bench whose run has placed something, and stopped."""
    b = bench()
    planner = started(b, **parameters)
    planner.retreats = retreats
    planner.offers.append(0.1)
    b.wait(lambda: b.manifests()[-1]["solution"] == "1")
    b.call("stop")
    b.wait(lambda: b.status()["state"] == "stopped")
    b.wait(lambda: b.node._reporter._watch._looked.placement is not None)
    return b


def looked_at(b):
    """Wait until the newest cloud is held against the placement."""
    watching = b.node._reporter._watch

    def is_done():
        newer = watching._to_look_at(b.snapshots[-1])
        seen = {topic: cloud.points for topic, (cloud, _) in watching._looked.seen.items()}
        return all(cloud.points is seen.get(topic) for topic, cloud in newer.items())

    b.wait(is_done)


def why_not(b):
    """What the node would say now of the best placement."""
    run = b.node._commands.run
    return b.node._reporter._why_invalid(run, run.best)


def until(b, valid, words="", again=None):
    """Wait for the status, doing something again and again."""
    b.wait(
        lambda: b.status()["best_valid"] == valid and words in b.status()["best_invalid_reason"],
        again=again,
    )


def test_joint_states_that_die_are_told_until_they_come_again(bench):
    b = placed(bench, joint_state_timeout=0.5)
    timeout = Parameter("joint_state_timeout", value=0.5)
    assert b.node.set_parameters([timeout])[0].successful
    until(b, "false", "joint_state_timeout = 0.5 s")
    assert "yumi_joint" in b.status()["best_invalid_reason"]
    b.wait(lambda: b.status()["inputs"] == "no recent joint states")
    told, ticks = len(b.messages("status")), len(b.messages("diagnostics"))
    b.wait(lambda: len(b.messages("diagnostics")) > ticks + 1)
    assert len(b.messages("status")) == told  # in the same words, so once
    until(b, "true", again=b.joint_state)


def test_clouds_that_went_stale_are_told_until_they_come_again(bench):
    b = placed(bench, cloud__max_age=2.0)
    until(b, "false", "clouds on points are older than cloud.max_age = 2 s")
    until(b, "true", again=b.cloud)


def test_another_object_is_told_and_the_same_once_more_is_not(bench):
    b = placed(bench)
    again = [b.node.get_parameter(n) for n in ("object.vertices", "object.triangles")]
    assert all(r.successful for r in b.node.set_parameters(again))
    assert not why_not(b)
    publisher = b.client.create_publisher(Mesh, "placement_planner/object", LATCHED)
    held = object_by_name("large_crayons_box")
    corners = [Point(x=x, y=y, z=z) for x, y, z in held.vertices.tolist()]
    triangles = [MeshTriangle(vertex_indices=t.astype(np.uint32)) for t in held.triangles]
    publisher.publish(Mesh(vertices=corners, triangles=triangles))
    until(b, "false", "the object was replaced")
    assert all(r.successful for r in b.node.set_parameters(again))
    until(b, "true")
    assert b.node.set_parameters([Parameter("object.scale", value=1.1)])[0].successful
    until(b, "false", "the object was replaced")


def test_another_robot_is_told_be_it_ready_or_not(bench):
    b = placed(bench)
    publisher = b.client.create_publisher(String, "robot_description", LATCHED)
    publisher.publish(String(data="<robot"))
    until(b, "false", "the robot was replaced")


def place_of(b, link="gripper_l_base", at=0.0, offset=(0.0, 0.0, 0.0)):
    """Where a link is, `at` of the way from the start (0) to where the fake motion ends (1)."""
    robot = b.node._inputs.robot.robot
    moved = {
        j: v + 0.05 * at * j.startswith("yumi_joint") * j.endswith("_l") for j, v in HOME.items()
    }
    return robot.link_pose(robot.configuration(moved), link).act(np.array(offset))


@pytest.fixture
def resting(bench):
    """A bench with a placement that retreats."""
    return placed(bench, retreats=True)


def test_ordinary_clouds_change_nothing(resting):
    b = resting
    rng = np.random.default_rng(0)
    robot = np.vstack(
        [
            place_of(b, link) + rng.normal(0.0, 0.003, (200, 3))
            for link in ("yumi_link_3_l", "yumi_link_5_l", "gripper_l_base", "yumi_link_4_r")
        ]
    )
    grasp = b.snapshots[-1].arms[0].grasps[0]
    held = np.array([place_of(b, offset=grasp.act(p)) for p in rng.normal(0.0, 0.01, (500, 3))])
    noise = TABLE + rng.normal(0.0, 0.0002, TABLE.shape)
    pixel = place_of(b, "yumi_link_5_l", 1.0)[None] + [[0.2, 0.3, 0.4]]
    shifted = TABLE + np.array([0.0024, 0.0017, 0.0])
    for points in (noise, shifted, TABLE[:0], np.vstack([TABLE, robot, held, pixel])):
        message = message_from_points(points, Header(frame_id=FRAME))
        b.node._inputs.take_cloud("points", message, b.node._settings.current)
        looked_at(b)
        assert why_not(b) == ""


def test_flying_pixels_on_the_way_are_no_block_and_a_small_thing_there_is(resting):
    b = resting
    run, grasp = b.node._commands.run, b.snapshots[-1].arms[0].grasps[0]
    way = watch.way_of(run.snapshot, run.planner.environment, run.best)
    around = np.mgrid[-1:2, -1:2, 0:1].reshape(3, -1).T
    within = np.random.default_rng(0).uniform(-0.05, 0.05, (200, 3))
    comes_to = (place_of(b, at=1.0, offset=grasp.act(p)) for p in within)
    middle = next(
        p
        for p in comes_to
        if all(way.blocked_by(p + apart * around, None) for apart in (0.003, 0.012))
    )
    sensor = middle + np.array([0.0, 0.0, 1.0])
    pixel = 1.0 / 340.0
    row, column = np.mgrid[-60:61, -60:61]
    down = np.stack([pixel * row, pixel * column, np.full(row.shape, -1.0)], axis=-1)
    depth = np.full(row.shape, sensor[2])  # of the table
    depth += np.random.default_rng(0).normal(0.0, 0.0005, row.shape)

    def seen(there):
        """(n, 3) what is seen where some pixels see something in the way."""
        cloud = sensor + down * np.where(there, 1.0, depth)[..., None]
        return cloud.reshape(-1, 3)

    flying = seen((row % 4 == 0) & (column % 4 == 0) & (abs(row) <= 4) & (abs(column) <= 4))
    thing = seen((abs(row) <= 1) & (abs(column) <= 1))
    assert "meets something new" in way.blocked_by(flying, None)
    assert way.blocked_by(flying, sensor) == ""
    assert "meets something new" in way.blocked_by(thing, sensor)


def ends_of(b):
    """(n, 3) points where the box ends, beyond where it is held now and the padding around it."""
    grasp = b.snapshots[-1].arms[0].grasps[0]
    within = np.random.default_rng(0).uniform(-0.05, 0.05, (3000, 3))
    return np.array([place_of(b, at=1.0, offset=grasp.act(p)) for p in within])


def test_a_cloud_that_came_before_a_solution_is_never_overlooked(bench, monkeypatch):
    b = bench()
    planner = started(b)
    go_on, make = threading.Event(), watch.way_of
    monkeypatch.setattr(watch, "way_of", lambda *of: make(*of) if go_on.wait(60.0) else None)
    updates = b.node._inputs.clouds.updates
    b.cloud(np.vstack([TABLE, ends_of(b)]))
    b.wait(lambda: b.node._inputs.clouds.updates > updates)
    planner.offers.append(0.1)
    until(b, "false", "not been held against newer clouds yet")
    assert b.status()["solutions"] == "1"
    assert b.status()["best_valid_known"] == "false"
    go_on.set()
    until(b, "false", "a newer cloud cuts through it")
    assert b.status()["best_valid_known"] == "true"
    assert "true" not in {values_of(m)["best_valid"] for m in b.messages("status")}


def test_a_block_in_the_way_is_told_and_that_it_has_gone(resting):
    b = resting
    ends, stray = ends_of(b), np.full((10, 3), 1e6)
    b.cloud(np.vstack([TABLE, ends, stray]))
    until(b, "false", "a newer cloud cuts through it")
    assert "meets something new at (" in b.status()["best_invalid_reason"]
    moved = message_from_points(np.vstack([TABLE, ends + 2e-3, stray]), Header(frame_id=FRAME))
    b.node._inputs.take_cloud("points", moved, b.node._settings.current)
    assert why_not(b)
    b.cloud()
    until(b, "true")
    # What moved by 2 mm is told in the words it was told in, however often that is.
    reasons = {values_of(m)["best_invalid_reason"] for m in b.messages("status")}
    assert len({r for r in reasons if "a newer cloud cuts through it" in r}) == 1


def test_what_cannot_be_looked_at_is_not_called_valid(bench, monkeypatch):
    def fail(*_):
        raise ZeroDivisionError("a fault")

    monkeypatch.setattr(watch, "way_of", fail)
    b = bench()
    started(b).offers.append(0.1)
    until(b, "false", "cannot be held against newer clouds", again=b.cloud)
