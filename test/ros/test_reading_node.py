"""What the node says while it reads robot and object, and of those that cannot be read."""

import os
import threading

import numpy as np
import pytest
import trimesh
from geometry_msgs.msg import Point
from helpers.fakes import TABLE
from rclpy.parameter import Parameter
from shape_msgs.msg import Mesh, MeshTriangle
from std_msgs.msg import String

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.share import share_path

YUMI = share_path("urdf", "yumi.urdf").read_text()
PAIRS = {"robot_description_semantic": share_path("urdf", "yumi.srdf").read_text()}
BOX = trimesh.creation.box((0.1, 0.06, 0.04))


@pytest.fixture
def slow(monkeypatch):
    """Makes robots and bodies wait until they are let through."""
    gates = {Robot: threading.Event(), Body: threading.Event()}

    def hold(kind, name):
        original = getattr(kind, name)

        def held(*args, **options):
            gates[kind].wait(60.0)
            return original(*args, **options)

        monkeypatch.setattr(kind, name, held)

    def begin():
        hold(Robot, "from_urdf")
        hold(Body, "from_mesh")
        return gates

    yield begin
    for gate in gates.values():
        gate.set()


def message(mesh):
    return Mesh(
        vertices=[Point(x=x, y=y, z=z) for x, y, z in np.asarray(mesh.vertices).tolist()],
        triangles=[MeshTriangle(vertex_indices=np.uint32(t)) for t in np.asarray(mesh.faces)],
    )


def code(b, **parameters):
    """The code of a start; a run that begins is stopped."""
    answer = b.call("start_with", **parameters)
    if answer.success:
        b.wait(lambda: b.call("stop").success)  # STOPPING while kernels compile
    return answer.code


def settled(b, **parameters):
    """The code of a start once everything is read."""
    b.wait(lambda: code(b, **parameters) != "NOT_READY")
    return code(b, **parameters)


def test_a_new_robot_is_waited_for_and_the_old_one_is_not_used(bench, slow):
    b = bench(**PAIRS)
    b.feed()
    assert code(b) == "OK"
    gates = slow()
    described = b.client.create_publisher(String, "robot_description", LATCHED)
    described.publish(String(data=YUMI.replace('<robot name="yumi"', '<robot name="other"')))
    b.wait(lambda: b.status()["robot"] == "reading")
    assert code(b) == "NOT_READY"
    assert b.call("stop").code == "NOT_RUNNING"
    gates[Robot].set()
    b.wait(lambda: b.status()["robot"] == "ready")
    b.cloud()
    b.wait(lambda: code(b) == "OK", again=b.cloud)
    assert b.snapshots[-1].robot.name == "other"


def test_a_cloud_that_came_while_the_robot_was_bad_waits_for_a_good_one(bench):
    b = bench(**PAIRS)
    b.feed()
    described = b.client.create_publisher(String, "robot_description", LATCHED)
    described.publish(String(data="<robot/>"))
    b.wait(lambda: b.status()["robot"] == "bad")
    b.cloud(2.0 * TABLE)  # once, as of a scene that does not change
    b.wait(lambda: b.node._inputs._waiting)
    assert code(b) == "BAD_ROBOT"
    described.publish(String(data=YUMI))
    b.wait(lambda: b.status()["robot"] == "ready")
    assert code(b) == "OK"
    np.testing.assert_allclose(b.snapshots[-1].clouds[0], 2.0 * TABLE, atol=1e-6)


@pytest.mark.parametrize("error", [None, MemoryError(), KeyError("link")])
def test_a_robot_that_cannot_be_read_is_bad_until_a_good_one_comes(bench, monkeypatch, error):
    b = bench(**PAIRS)
    b.feed()
    assert code(b) == "OK"
    text = "<robot name='none'/>"
    if error is not None:
        text = YUMI.replace("1.0", "1.00")

        def fail(*args, **options):
            raise error

        monkeypatch.setattr(Robot, "from_urdf", fail)
    described = b.client.create_publisher(String, "robot_description", LATCHED)
    described.publish(String(data=text))
    b.wait(lambda: b.status()["robot"] == "bad")
    for _ in range(2):
        assert code(b) == "BAD_ROBOT"
    monkeypatch.undo()
    described.publish(String(data=YUMI))
    b.wait(lambda: b.status()["robot"] == "ready")
    b.wait(lambda: code(b) == "OK", again=b.cloud)


def test_the_object_of_one_call_is_read_by_that_call(bench, slow, tmp_path):
    b = bench(file_roots=[str(tmp_path)])
    b.feed()
    assert settled(b) == "OK"
    gates = slow()
    BOX.export(tmp_path / "box.stl")
    file = str(tmp_path / "box.stl")
    before = len(b.snapshots)
    for _ in range(3):
        assert code(b, object__mesh=file) == "NOT_READY"
    assert code(b) == "OK"  # the node's own is still there
    gates[Body].set()
    assert settled(b, object__mesh=file) == "OK"
    assert len(b.snapshots) > before + 1
    assert np.ptp(b.snapshots[-1].body.vertices, axis=0).max() == pytest.approx(0.1)


def test_an_object_that_is_none_is_bad_until_a_good_one_comes(bench, tmp_path):
    b = bench(file_roots=[str(tmp_path)])
    b.feed()
    publisher = b.client.create_publisher(Mesh, "placement_planner/object", LATCHED)
    flat = trimesh.Trimesh(BOX.vertices * [1, 1, 0], BOX.faces, process=False)
    beyond = message(BOX)
    beyond.triangles[3].vertex_indices = np.array([0, 1, 80], np.uint32)
    nothing = Mesh(vertices=message(BOX).vertices)
    nan = message(BOX)
    nan.vertices[2].y = float("nan")
    for wrong in (message(flat), beyond, nothing, nan):
        publisher.publish(message(BOX))
        b.wait(lambda: b.status()["object"] == "ready")
        publisher.publish(wrong)
        b.wait(lambda: b.status()["object"] == "bad")
        assert code(b) == "BAD_OBJECT"
    turned = message(BOX)
    turned.triangles[0].vertex_indices = turned.triangles[0].vertex_indices[::-1]
    publisher.publish(turned)
    b.wait(lambda: b.status()["object"] == "ready")
    assert code(b) == "OK"
    # A file whose header is in order, and whose contents are not.
    data = bytearray(BOX.export(file_type="stl"))
    data[84:] = b"\xff" * (len(data) - 84)
    (tmp_path / "nan.stl").write_bytes(data)
    parameter = Parameter("object.mesh", value=str(tmp_path / "nan.stl"))
    assert b.node.set_parameters([parameter])[0].successful
    b.wait(lambda: b.status()["object"] == "bad")
    answer = b.call("start")
    assert "nan.stl" in answer.text
    assert "not finite" in answer.text


def test_what_could_roll_from_every_side_is_refused_until_that_is_allowed(bench):
    b = bench()
    b.feed()
    publisher = b.client.create_publisher(Mesh, "placement_planner/object", LATCHED)
    publisher.publish(message(trimesh.creation.icosphere(subdivisions=2, radius=0.02)))
    b.wait(lambda: code(b) == "BAD_OBJECT")
    answer = b.call("start")
    assert (answer.success, answer.code) == (False, "BAD_OBJECT")
    for name in ("object.allow_rolling", "object.center_of_mass", "object.flatness"):
        assert name in answer.text
    for name, value in (("object.flatness", 0.0), ("object.allow_rolling", 2)):
        assert not b.node.set_parameters([Parameter(name, value=value)])[0].successful
    b.wait(lambda: code(b, object__allow_rolling=True) != "NOT_READY")
    assert code(b, object__allow_rolling=True) == "OK"
    assert b.call("start").code == "BAD_OBJECT"  # that was for one run only
    assert b.node.set_parameters([Parameter("object.allow_rolling", value=True)])[0].successful
    assert settled(b) == "OK"


def test_the_log_tells_what_is_assumed_of_the_object(bench, capfd):
    b = bench(**{"object.scale": 0.5})
    b.feed()
    publisher = b.client.create_publisher(Mesh, "placement_planner/object", LATCHED)
    publisher.publish(message(BOX))
    logged = []
    b.wait(lambda: logged.append(capfd.readouterr().err) or "0.05 x 0.03 x 0.02 m" in logged[-1])
    assert "object.scale 0.5" in logged[-1]
    assert "centre of mass (0.0000, 0.0000, 0.0000) of uniform density" in logged[-1]
    assert "closed" in logged[-1]
    assert "rests: 6" in logged[-1]


@pytest.mark.parametrize("name", ["cut.stl", "none.stl", "pipe.stl"])
def test_the_node_starts_whatever_its_object_is(bench, tmp_path, name):
    path = tmp_path / name
    if name == "pipe.stl":
        os.mkfifo(path)
    elif name != "none.stl":
        path.write_bytes(BOX.export(file_type="stl")[:300])
    b = bench(**{"object.mesh": str(path), "object.vertices": None, "object.triangles": None})
    b.feed()
    assert settled(b) == "BAD_OBJECT"
    assert b.status()["object"] == "bad"
    held = object_by_name("small_crayons_box")
    values = {
        "object.vertices": held.vertices.ravel().tolist(),
        "object.triangles": held.triangles.ravel().tolist(),
    }
    said = b.node.set_parameters_atomically([Parameter(n, value=v) for n, v in values.items()])
    assert said.successful
    assert settled(b) == "OK"


def test_files_named_later_are_read_only_where_the_operator_said(bench, tmp_path):
    (tmp_path / "open").mkdir()
    BOX.export(tmp_path / "open/box.stl")
    BOX.export(tmp_path / "start.stl")
    BOX.export(tmp_path / "secret.stl")
    b = bench(file_roots=[str(tmp_path / "open")], **{"object.mesh": str(tmp_path / "start.stl")})
    b.feed()
    answers = {}
    for file in ("secret.stl", "none_at.stl"):
        answer = b.call("start_with", object__mesh=str(tmp_path / file))
        answers[file] = answer.text.replace(file, "*")
        said = b.node.set_parameters([Parameter("object.mesh", value=str(tmp_path / file))])[0]
        assert not said.successful
        answers[file] += said.reason.replace(file, "*")
    assert answers["secret.stl"] == answers["none_at.stl"]
    assert "file_roots" in answers["secret.stl"]
    for file in ("open/box.stl", "start.stl"):
        assert settled(b, object__mesh=str(tmp_path / file)) == "OK"
    # The same of meshes that a description by topic names.
    described = b.client.create_publisher(String, "robot_description", LATCHED)
    reasons = []
    for number, file in enumerate(("secret.stl", "none_at.stl")):
        shape = f'<mesh filename="{tmp_path / file}"/>'
        text = f'<robot name="r{number}"><link name="a"><collision><geometry>{shape}'
        described.publish(String(data=f"{text}</geometry></collision></link></robot>"))
        b.wait(lambda file=file: file in b.call("start").text)
        answer = b.call("start")
        assert answer.code == "BAD_ROBOT"
        reasons.append(answer.text.replace(file, "*"))
    assert reasons[0] == reasons[1]


def test_inputs_that_are_far_too_large_are_refused_with_their_limit(bench):
    b = bench()
    b.feed()
    answer = b.call("start_with", target_volume=[-500.0, -500.0, 0.0, 500.0, 500.0, 1000.0])
    assert answer.code == "BAD_VOLUME"
    assert "target_volume" in answer.words
    pose = [0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]
    answer = b.call("start_with", left__grasps=pose * 201)
    assert answer.code == "BAD_GRASP"
    assert "201" in answer.words
    assert "200" in answer.words
    b.cloud(np.zeros((5_000_001, 3)))
    b.wait(lambda: "5000001 points" in b.call("start").text)
    b.cloud(TABLE)
    b.wait(lambda: "points" not in b.call("start").text, again=b.joint_state)
    b.call("stop")
    # The joint in millimetres.
    b.joint_state(gripper_l_joint=25.0)
    b.wait(
        lambda: b.call("start").code == "BAD_START",
        again=lambda: b.joint_state(gripper_l_joint=25.0),
    )
    words = b.call("start").words
    assert "gripper_l_joint = 25" in words
    assert "0.025]" in words
