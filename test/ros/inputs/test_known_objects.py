"""Things that are known without a cloud."""

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.ros.inputs.known_objects import KnownObjects
from placement_planner_ros.ros.inputs.known_surface import PlacedBody
from placement_planner_ros.ros.inputs.resources import Files

LOW, HIGH = np.full(3, -3.0), np.full(3, 3.0)


def marker(kind, scale=(1.0, 1.0, 1.0), at=(0.0, 0.0, 0.0), ns="scene", number=1, **fields):
    made = Marker(type=kind, ns=ns, id=number, header=Header(frame_id="map"), **fields)
    made.scale = Vector3(x=scale[0], y=scale[1], z=scale[2])
    made.pose.position = Point(x=at[0], y=at[1], z=at[2])
    return made


def told(*markers, roots=()):
    known = KnownObjects(Files((), roots))
    return known, known.take(MarkerArray(markers=list(markers)))


def points_of(known, T_planning_map=None):
    T = pin.SE3.Identity() if T_planning_map is None else T_planning_map
    return [each.within(LOW, HIGH).points for each in known.surfaces(lambda frame: T)]


def test_a_cube_is_where_its_frame_and_pose_put_it():
    known, faults = told(marker(Marker.CUBE, (0.2, 0.4, 0.1), (1.0, 0.0, 0.5)))
    turned = pin.SE3(pin.utils.rotate("z", np.pi / 2), np.array([0.0, 0.0, 1.0]))
    (points,) = points_of(known, turned)
    assert not faults
    low, high = points.min(axis=0), points.max(axis=0)
    assert np.allclose(low, [-0.2, 0.9, 1.45])
    assert np.allclose(high, [0.2, 1.1, 1.55])


@pytest.mark.parametrize("kind", [Marker.SPHERE, Marker.CYLINDER])
def test_what_is_round_is_so_to_a_fraction_of_a_millimetre(kind):
    known, _ = told(marker(kind, (0.3, 0.3, 0.3)))
    (points,) = points_of(known)
    away = points if kind == Marker.SPHERE else points[np.abs(points[:, 2]) < 0.14, :2]
    assert np.abs(np.linalg.norm(away, axis=1) - 0.15).max() < 0.0004
    assert np.allclose([points.min(axis=0)[2], points.max(axis=0)[2]], [-0.15, 0.15])


def test_triangles_and_mesh_files(tmp_path):
    corners = [Point(x=0.0, y=0.0, z=0.0), Point(x=1.0, y=0.0, z=0.0), Point(x=0.0, y=1.0, z=0.0)]
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.export(tmp_path / "box.stl")
    mesh = marker(Marker.MESH_RESOURCE, (2.0, 1.0, 1.0), number=2)
    mesh.mesh_resource = f"file://{tmp_path}/box.stl"
    known, faults = told(
        marker(Marker.TRIANGLE_LIST, (0.5, 0.5, 1.0), points=corners), mesh, roots=[str(tmp_path)]
    )
    assert not faults
    for key in list(known.reading._jobs):
        known.reading.wait(key, 60.0)
    triangle, read = points_of(known)
    assert np.allclose(triangle.max(axis=0), [0.5, 0.5, 0.0])
    assert np.allclose(read.max(axis=0), [0.1, 0.05, 0.05])
    _, (fault,) = told(mesh)  # of a folder that is not open
    assert "file_roots" in str(fault)


def test_adding_replaces_and_deleting_forgets():
    known, _ = told(marker(Marker.CUBE), marker(Marker.CUBE, number=2), marker(Marker.CUBE, ns="b"))
    assert len(known) == 3
    known.take(MarkerArray(markers=[marker(Marker.CUBE, (0.1, 0.1, 0.1))]))
    assert len(known) == 3
    assert min(np.ptp(p, axis=0).max() for p in points_of(known)) == pytest.approx(0.1)
    known.take(MarkerArray(markers=[marker(0, number=2, action=Marker.DELETE)]))
    assert len(known) == 2
    known.take(MarkerArray(markers=[marker(0, ns="b", action=Marker.DELETEALL)]))
    assert len(known) == 1
    known.take(MarkerArray(markers=[marker(0, ns="", action=Marker.DELETEALL)]))
    assert len(known) == 0


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (marker(Marker.CUBE, (0.0, 1.0, 1.0)), "scale"),
        (marker(Marker.CUBE, at=(0.0, np.nan, 0.0)), "pose"),
        (marker(Marker.ARROW), "CYLINDER"),
        (marker(Marker.TRIANGLE_LIST, points=[Point()]), "three for each triangle"),
        (marker(Marker.MESH_RESOURCE, mesh_resource="file:///etc/passwd"), "file_roots"),
    ],
    ids=["scale", "position", "type", "points", "file"],
)
def test_what_is_wrong_is_told_and_no_start_goes_without_it(bad, words):
    known, faults = told(bad)
    assert len(faults) == 1
    assert words in str(faults[0])
    with pytest.raises(PlacementPlannerError, match=words):
        points_of(known)
    known.take(MarkerArray(markers=[marker(Marker.CUBE)]))
    assert len(points_of(known)) == 1


def test_a_large_floor_is_made_of_points_only_near_the_robot():
    known, _ = told(marker(Marker.CUBE, (100.0, 100.0, 0.1)))
    (surface,) = known.surfaces(lambda frame: pin.SE3.Identity())
    points = surface.within(np.full(3, -0.4), np.full(3, 0.4)).points
    assert np.allclose(points.min(axis=0), [-0.5, -0.5, -0.05])
    assert len(points) < 300_000
    assert surface.within(np.full(3, -0.45), np.full(3, 0.4)).points is points, "made once"


def test_what_a_run_placed_stands_in_one_place_until_it_is_removed():
    known, _ = told(marker(Marker.CUBE, (0.2, 0.2, 0.2)))
    cube = trimesh.creation.box((0.1, 0.1, 0.1))
    body = Body.from_mesh(cube.vertices, cube.faces)
    here, there = (
        PlacedBody.at(body, pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))) for x in (0.0, 2.0)
    )
    for run, thing in ((7, here), (9, here), (7, there)):
        known.confirm(run, thing)
    assert list(known.placed) == [9, 7]
    assert [p.mean(axis=0)[0].round(3) for p in points_of(known)] == [0.0, 0.0, 2.0]
    assert known.remove(9) is here
    assert known.remove(9) is None
    assert list(known.placed) == [7]
