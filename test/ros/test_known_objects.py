"""The node with things that are known, and no cloud."""

import time

import numpy as np
from geometry_msgs.msg import Point, Vector3
from helpers.fakes import FRAME
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from placement_planner_ros.ros.qos import LATCHED


def test_known_objects_are_enough_to_start_and_are_what_is_planned_with(bench):
    b = bench()
    table = Marker(type=Marker.CUBE, ns="scene", id=1, header=Header(frame_id=FRAME))
    table.scale = Vector3(x=0.4, y=0.6, z=0.04)
    table.pose.position = Point(x=0.4, y=0.0, z=-0.02)
    tell = b.client.create_publisher(MarkerArray, "placement_planner/known_objects", LATCHED)
    b.joint_state()
    ready = b.node._inputs.joints
    b.wait(lambda: ready.age(time.monotonic()) < 0.5, again=b.joint_state)
    assert b.call("start").code == "NO_CLOUD"
    tell.publish(MarkerArray(markers=[table]))
    b.wait(lambda: b.status()["known_objects"] == "1")
    b.joint_state()
    answer = b.call("start")
    while answer.code == "NOT_READY":
        b.joint_state()
        answer = b.call("start")
    assert answer.code == "OK", answer.text
    b.wait(lambda: b.planners and b.planners[-1].searching.is_set())
    points = np.vstack(b.snapshots[-1].clouds)
    assert np.allclose(points.max(axis=0), [0.6, 0.3, 0.0])
    b.planners[-1].offers.append(0.1)
    b.wait(lambda: b.status().get("best_valid") == "true", again=b.joint_state)
    tell.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
    b.wait(lambda: b.status()["known_objects"] == "0")
    b.wait(lambda: "known objects" in b.status()["best_invalid_reason"], again=b.joint_state)
    assert b.call("stop").code == "OK"
