import numpy as np
import pinocchio as pin
import pytest
import trimesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.errors import CloudError
from placement_planner_ros.ros.inputs import cloud_store
from placement_planner_ros.ros.inputs.cloud_store import CloudStaleError, CloudStore, PointSet
from placement_planner_ros.ros.inputs.known_surface import PlacedBody

A = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
B = np.array([[5.0, 0.0, 0.0]])


def cloud(topic, points, time, origin=None):
    return PointSet(points, origin, topic=topic, time=time)


def standing(x, angle=0.0):
    """A cube of 0.1 m whose centre is at (x, 0, 0)."""
    cube = trimesh.creation.box((0.1, 0.1, 0.1))
    T = pin.SE3(pin.utils.rotate("z", angle), np.array([x, 0.0, 0.0]))
    return PlacedBody.at(Body.from_mesh(cube.vertices, cube.faces), T)


def snapshot_of(store, mode, max_age, now):
    """What a run begins with, or what keeps it from beginning."""
    for fault in store.faults(mode, max_age, now):
        raise fault
    return store.parts(mode)


def points_of(parts):
    return np.vstack([part.points for part in parts])


def test_every_required_topic_must_have_delivered():
    store = CloudStore(["left", "right"])
    store.add(cloud("left", A, 0.0))
    with pytest.raises(CloudError, match="right"):
        snapshot_of(store, "latest", 0.0, 1.0)
    store.add(cloud("right", B, 0.0))
    np.testing.assert_array_equal(
        points_of(snapshot_of(store, "latest", 0.0, 1.0)), np.vstack([A, B])
    )


def test_latest_replaces_and_merge_accumulates():
    store = CloudStore(["points"])
    for points in (A, B):
        store.add(cloud("points", points, 0.0))
        store.merge(points, 0.01)
    np.testing.assert_array_equal(points_of(snapshot_of(store, "latest", 0.0, 0.0)), B)
    merged = points_of(snapshot_of(store, "merge", 0.0, 0.0))
    assert {tuple(p) for p in merged} == {tuple(p) for p in np.vstack([A, B])}
    store.clear()
    np.testing.assert_array_equal(points_of(snapshot_of(store, "merge", 0.0, 0.0)), B)


def test_no_more_points_accumulate_than_there_may_be(monkeypatch):
    store = CloudStore(["points"])
    monkeypatch.setattr(cloud_store, "MAX_POINTS", 5)
    points = np.arange(15.0).reshape(5, 3)
    store.merge(points, 0.01)
    with pytest.raises(CloudError, match=r"6 points.*may be 5; call clear_environment"):
        store.merge(np.vstack([points[:2], B]), 0.01)
    np.testing.assert_array_equal(store.merged, points)
    store.merge(points, 0.01)  # which shows nothing new
    store.clear()
    store.merge(B, 0.01)


def test_old_clouds_are_stale_unless_any_age_will_do():
    store = CloudStore(["points"])
    store.add(cloud("points", A, 10.0))
    assert snapshot_of(store, "latest", 5.0, 14.9)
    with pytest.raises(CloudStaleError, match="points") as error:
        snapshot_of(store, "latest", 5.0, 15.1)
    assert error.value.code == "CLOUD_STALE"
    with pytest.raises(CloudStaleError, match="stamped by the clock of the joint states"):
        snapshot_of(store, "latest", 5.0, 1e6)
    assert snapshot_of(store, "latest", 0.0, 1e6)


def test_points_accumulated_in_what_is_removed_go_with_it():
    store = CloudStore(["points"])
    store.add(cloud("points", B, 0.0))
    # Turned by 45 degrees about z, the cube of 0.1 m reaches 0.0707 m along x.
    store.merge(
        np.array([[3.0, 0.0, 0.0], [3.068, 0.0, 0.0], [3.05, 0.05, 0.0], [3.08, 0, 0]]), 0.01
    )
    for padding, kept in ((0.0, [[3.05, 0.05, 0.0], [3.08, 0.0, 0.0]]), (0.01, [[3.05, 0.05, 0]])):
        cube = standing(3.0, np.pi / 4)
        store.forget(lambda points: cube.holds(points, padding))  # noqa: B023
        left = snapshot_of(store, "merge", 0.0, 0.0)[-1].points
        np.testing.assert_array_equal(left, kept)
