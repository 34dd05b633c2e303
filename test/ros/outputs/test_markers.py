"""The markers of a run: V, what is kept out of, and what leans."""

import numpy as np
import pinocchio as pin
import pytest
from helpers.leaning import leaning_poses, situations
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from placement_planner_ros.core.types import Resting, TargetVolume
from placement_planner_ros.ros.outputs.markers import (
    FORCE_LENGTH_M,
    placement_markers,
    scene_markers,
)
from placement_planner_ros.view.drawn_markers import drawn_points

MAP = Header(frame_id="map")


def test_every_box_of_the_volume_and_to_keep_out_of_is_drawn():
    lower = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.2], [0.5, 0.0, 0.0]])
    upper = lower + np.array([[0.5, 0.4, 0.3], [0.2, 0.2, 0.1], [0.1, 0.4, 0.3]])
    keep_out = np.stack([lower[:2] - 1.0, upper[:2]], axis=1)
    drawn = scene_markers(MAP, TargetVolume(lower, upper), keep_out, [], [])
    assert len({(marker.ns, marker.id) for marker in drawn}) == len(drawn)
    for name, corners in (
        ("target_volume", np.stack([lower, upper], axis=1)),
        ("keep_out", keep_out),
    ):
        boxes = [marker for marker in drawn if marker.ns == name]
        for (low, high), marker in zip(corners, boxes, strict=True):
            at, size = marker.pose.position, marker.scale
            np.testing.assert_allclose([at.x, at.y, at.z], (low + high) / 2)
            np.testing.assert_allclose([size.x, size.y, size.z], high - low)


def test_what_leans_is_drawn_with_its_wall_and_the_cones_that_hold_it():
    situation = situations(0)[0]
    rng = np.random.default_rng(1)
    contact = situation.contact(situation.environment("complete", rng))
    T, feature = leaning_poses(contact, rng, most=1)[0]
    resting, body = contact.resting(pin.SE3(T), feature), situation.body
    drawn = placement_markers(MAP, body, pin.SE3(T), np.zeros((2, 3)), resting)
    assert {(marker.header.frame_id, marker.action) for marker in drawn} == {("map", Marker.ADD)}
    read = drawn_points(MarkerArray(markers=drawn))
    begins, ends = read["contacts"][::2], read["contacts"][1::2]
    # The floor at z = 0 holds by cones, the wall at x = 0.7 by pushes alone.
    pushes = begins[:, 0] > 0.69
    push = np.array([-FORCE_LENGTH_M, 0.0, 0.0])
    np.testing.assert_allclose((ends - begins)[pushes], [push, push], atol=1e-3)
    sides = (ends - begins)[~pushes & (np.abs(begins[:, 2]) < 1e-3)]
    steep = np.hypot(sides[:, 0], sides[:, 1]) / sides[:, 2]
    assert sides[:, 2] == pytest.approx(FORCE_LENGTH_M)
    assert sorted(set(steep.round(6))) == [0.0, 0.3]
    # The wall as far as it was measured, one plane that faces the object.
    assert len(read["wall"]) == 6
    assert read["wall"][:, 0] == pytest.approx(0.7, abs=1e-3)
    assert np.ptp(read["wall"][:, 1:], axis=0) == pytest.approx([1.2, 0.5], abs=0.06)
    assert "wall at (0.70, " in resting.on
    # What stands on a face has neither, and deletes those of the one before.
    none = np.zeros((0, 3))
    standing = Resting("face", "", none, none, np.zeros(0), none)
    gone = placement_markers(MAP, body, pin.SE3(T), np.zeros((2, 3)), standing)
    assert {m.ns for m in gone if m.action == Marker.DELETE} == {"contacts", "wall"}
    assert {m.ns for m in gone} == {m.ns for m in drawn}
