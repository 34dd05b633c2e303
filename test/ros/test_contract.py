"""What users rely on, message by message, asked of the real node in a process of its own."""

import math
import re
import signal

import numpy as np
import pytest
import trimesh
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point
from helpers.fakes import said, values_of
from helpers.system import NODE, PARTS, Client, start_node, start_when_ready, wait
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from shape_msgs.msg import Mesh, MeshTriangle
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker

from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.scenes.yumi import load_yumi, start_configuration
from placement_planner_ros.share import share_path

OWN_TOPICS = {
    "trajectory": "trajectory_msgs/msg/JointTrajectory",
    "retreat_trajectory": "trajectory_msgs/msg/JointTrajectory",
    "placement_pose": "geometry_msgs/msg/PoseStamped",
    "objective": "std_msgs/msg/Float64",
    "solution": "diagnostic_msgs/msg/DiagnosticArray",
    "status": "diagnostic_msgs/msg/DiagnosticStatus",
    "markers": "visualization_msgs/msg/MarkerArray",
    "occupancy": "sensor_msgs/msg/PointCloud2",
}
INPUTS = {
    "/points": "sensor_msgs/msg/PointCloud2",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/robot_description": "std_msgs/msg/String",
    f"/{NODE}/object": "shape_msgs/msg/Mesh",
}
TRIGGERS = ("start", "stop", "confirm_placed", "clear_environment")
WITH_PARAMETERS = ("start_with", "stop_with", "confirm_placed_with", "remove_placed")
DEFAULTS = {
    "time_limit": 30.0,
    "seed": -1,
    "sampler": "optimistic",
    "objective": "maximize_clearance",
    "require_retreat": True,
    "unknown_space": "free",
}
STATES = (
    *("idle", "preparing", "searching", "stopping", "stopped", "time_limit", "exhausted"),
    *("robot_moved", "failed"),
)
STATUS_KEYS = {
    *("run", "state", "code", "robot", "object", "placed", "warm", "solutions", "samples"),
    *("objective", "best_valid", "best_invalid_reason"),
}


@pytest.fixture(scope="module")
def run(scene, client):
    """Number of a run with at least two solutions that was stopped, and stop's answer."""
    number = start_when_ready(client, "start_with", seed=3).run
    wait(lambda: client.last_solution(number) >= 2)
    stopped = client.call("stop")
    wait(lambda: client.last_solution(number) == int(stopped.solution))
    wait(lambda: client.state() == "stopped")
    return number, stopped


def parameter_names(client):
    request = ListParameters.Request()
    return list(client.request(ListParameters, "list_parameters", request).result.names)


def mesh_message(vertices, triangles):
    return Mesh(
        vertices=[Point(x=x, y=y, z=z) for x, y, z in np.asarray(vertices).tolist()],
        triangles=[MeshTriangle(vertex_indices=np.array(t, np.uint32)) for t in triangles],
    )


def set_one(client, name, value):
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    return client.request(SetParameters, "set_parameters", request).results[0]


# --- names, types, qualities of service


def test_topics_have_their_types_and_are_latched(client):
    types = dict(client.get_topic_names_and_types())
    for topic, kind in OWN_TOPICS.items():
        assert types[f"/{NODE}/{topic}"] == [kind]
        (publisher,) = client.get_publishers_info_by_topic(f"/{NODE}/{topic}")
        assert publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        assert publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    (publisher,) = client.get_publishers_info_by_topic("/diagnostics")
    assert publisher.qos_profile.durability == DurabilityPolicy.VOLATILE


def test_inputs_are_subscribed_to_as_their_publishers_offer_them(scene, client):
    def subscription(topic):
        infos = client.get_subscriptions_info_by_topic(topic)
        return next((info for info in infos if info.node_name == NODE), None)

    for topic, kind in INPUTS.items():
        wait(lambda topic=topic: subscription(topic))
        assert subscription(topic).topic_type == kind
    latched = DurabilityPolicy.TRANSIENT_LOCAL
    for topic in ("/robot_description", f"/{NODE}/object"):
        assert subscription(topic).qos_profile.durability == latched
    assert subscription("/joint_states").qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT


def test_services_have_their_types(client):
    types = dict(client.get_service_names_and_types())
    for name in TRIGGERS:
        assert types[f"/{NODE}/{name}"] == ["std_srvs/srv/Trigger"]
    for name in WITH_PARAMETERS:
        assert types[f"/{NODE}/{name}"] == ["rcl_interfaces/srv/SetParametersAtomically"]


# --- parameters


def test_every_parameter_has_words_and_every_number_a_range(client):
    names = parameter_names(client)
    request = DescribeParameters.Request(names=names)
    for descriptor in client.request(
        DescribeParameters, "describe_parameters", request
    ).descriptors:
        if descriptor.name == "use_sim_time" or descriptor.name.startswith("start_type_desc"):
            continue  # rclpy's own
        assert len(descriptor.description) > 10, descriptor.name
        if descriptor.type == ParameterType.PARAMETER_DOUBLE:
            assert descriptor.floating_point_range or descriptor.additional_constraints, descriptor
        if descriptor.type == ParameterType.PARAMETER_INTEGER:
            assert descriptor.integer_range or descriptor.additional_constraints, descriptor


def test_defaults(client):
    request = GetParameters.Request(names=list(DEFAULTS))
    values = client.request(GetParameters, "get_parameters", request).values
    assert dict(zip(DEFAULTS, map(parameter_value_to_python, values), strict=True)) == DEFAULTS


def test_integers_are_taken_where_a_double_is_meant(client):
    assert set_one(client, "time_limit", 30).successful
    assert set_one(client, "target_volume", [0, 0, 0, 1, 1, 1]).successful
    box = [0.33, -0.53, 0.15, 0.75, 0.40, 0.44]
    assert set_one(client, "target_volume", box).successful


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("time_limit", -1.0),
        ("time_limit", math.nan),
        ("collision_margin", 5.0),
        ("sampler", "ucb1"),
        ("target_volume", [0.0, 0.0, 0.0]),
        ("target_volume", [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]),
        ("left.grasps", [0.0] * 6),
        ("left.grasps", [0.0] * 7),
        ("objective", "nicest"),
        ("cloud.mode", "all"),
        ("arms", [""]),
        ("seed", -2),
    ],
)
def test_a_bad_value_is_refused_when_it_is_set(client, name, value):
    answer = set_one(client, name, value)
    assert not answer.successful
    assert name.split(".")[-1] in answer.reason
    assert len(answer.reason.splitlines()) >= 1
    assert "Traceback" not in answer.reason


def test_topics_frames_and_the_robot_are_read_at_start_up(client):
    answer = set_one(client, "cloud_topics", ["other"])
    assert not answer.successful
    assert "cloud_topics" in answer.reason


@pytest.mark.parametrize("name", ["there.stl", "missing.stl"])
def test_whether_a_file_outside_the_roots_exists_is_not_told(client, tmp_path, name):
    (tmp_path / "there.stl").write_bytes(b"solid\nendsolid\n")
    answer = set_one(client, "object.mesh", str(tmp_path / name))
    assert not answer.successful
    assert answer.reason.replace(name, "") == set_one(
        client, "object.mesh", str(tmp_path / "neither.stl")
    ).reason.replace("neither.stl", "")


# --- one run


def test_the_first_line_of_an_answer_is_for_machines(run, client):
    number, stopped = run
    line = stopped.text.splitlines()[0]
    assert re.fullmatch(r"code=OK run=\d+ solution=\d+ objective=-?[\d.e-]+", line)
    assert 0 < int(number) < 2**63
    answer = client.call("stop")
    assert answer.success
    assert answer.text.splitlines()[0].startswith("code=NOT_RUNNING")


def test_a_start_clears_what_was_there_before(run, client):
    number, _ = run
    cleared = [m for m in client.heard["solution"] if values_of(m.status[0])["solution"] == "0"]
    assert number in {values_of(m.status[0])["run"] for m in cleared}
    again = start_when_ready(client, "start_with", seed=3, time_limit=0.05).run
    wait(lambda: client.value("run") == again and client.state() not in ("preparing", "searching"))
    kept = [m for m in client.heard["trajectory"] if m.header.frame_id == f"{again}/0"]
    assert kept
    assert not kept[0].points
    empty = [m for m in client.heard["retreat_trajectory"] if m.header.frame_id == f"{again}/0"]
    assert empty
    assert not empty[0].points
    assert any(m.markers[0].action == Marker.DELETEALL for m in client.heard["markers"])


def test_stamps_strictly_increase_and_the_pose_has_its_solutions(run, client):
    """Of two in quick succession a latched topic may keep only one."""

    def stamps(topic):
        return [(m.header.stamp.sec, m.header.stamp.nanosec) for m in client.heard[topic]]

    assert stamps("solution") == sorted(set(stamps("solution")))
    assert stamps("placement_pose") == sorted(set(stamps("placement_pose")))
    assert {m.header.frame_id for m in client.heard["placement_pose"]} == {"yumi_body"}
    last = next(
        m for m in reversed(client.heard["solution"]) if values_of(m.status[0])["solution"] != "0"
    )
    assert stamps("placement_pose")[-1] == (last.header.stamp.sec, last.header.stamp.nanosec)


def test_a_solution_says_all_of_itself(run, client):
    number, stopped = run
    manifests = client.solutions(number)
    needed = {
        *("run", "solution", "objective", "arm", "grasp", "face", "approach_start"),
        *("has_retreat", "search_time"),
    }
    for manifest in manifests:
        assert needed <= set(manifest)
        assert manifest["arm"] in ("left", "right")
        assert manifest["has_retreat"] in ("true", "false")
    objectives = [float(m["objective"]) for m in manifests]
    assert objectives == sorted(set(objectives))
    assert float(stopped.objective) == objectives[-1]
    message = next(
        m for m in client.heard["solution"] if values_of(m.status[0]) == manifests[-1]
    ).status[0]
    assert manifests[-1]["arm"] in message.message


def test_trajectories_are_ready_for_a_controller(run, client):
    number, _ = run
    q_start = start_configuration("small_crayons_box")
    robot = load_yumi()
    retreats = {m.header.frame_id: m for m in client.heard["retreat_trajectory"] if m.points}
    found = [
        m
        for m in client.heard["trajectory"]
        if m.points and m.header.frame_id.startswith(number) and m.header.frame_id in retreats
    ]
    assert found
    for message in found:
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == (0, 0)
        retreat = retreats[message.header.frame_id]
        for curve in (message, retreat):
            times = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in curve.points]
            assert times[0] >= 0.0
            assert (np.diff(times) > 0.0).all()
            count = len(curve.joint_names)
            for point in curve.points:
                assert len(point.positions) == len(point.velocities) == count
                assert len(point.accelerations) == count
            assert not np.any(curve.points[-1].velocities)
            index = [robot.index(joint) for joint in curve.joint_names]
            Q = np.array([p.positions for p in curve.points])
            assert (robot.lower[index] <= Q).all()
            assert (robot.upper[index] >= Q).all()
        np.testing.assert_allclose(
            message.points[0].positions,
            [q_start[joint] for joint in message.joint_names],
            atol=1e-6,
        )
        np.testing.assert_allclose(
            retreat.points[0].positions, message.points[-1].positions, atol=1e-9
        )


def test_status_says_where_the_run_stands(run, client):
    number, _ = run
    statuses = [values_of(m) for m in client.heard["status"]]
    assert all(set(s) >= {"run", "state", "code", "warm", "placed"} for s in statuses)
    assert {s["state"] for s in statuses} <= set(STATES)
    of_run = [s for s in statuses if s["run"] == number]
    states = [s["state"] for s in of_run]
    order = ["preparing", "searching", "stopping", "stopped"]
    ranks = [order.index(state) for state in states]
    assert ranks == sorted(ranks)
    assert {"searching", "stopped"} <= set(states)
    assert set(of_run[-1]) >= STATUS_KEYS
    assert of_run[-1]["code"] == "OK"
    assert (of_run[-1]["robot"], of_run[-1]["object"]) == ("ready", "ready")
    assert [int(s["samples"]) for s in of_run if "samples" in s][-1] > 0


def test_diagnostics_come_every_second_or_so(client):
    heard = []
    subscription = client.create_subscription(DiagnosticArray, "/diagnostics", heard.append, 10)
    wait(lambda: len(heard) >= 2)
    client.drop(client.destroy_subscription, subscription)
    assert any(NODE in status.name for m in heard for status in m.status)


# --- inputs


def test_the_object_given_last_wins(scene, client):
    publisher = client.create_publisher(Mesh, f"{NODE}/object", LATCHED)
    wait(lambda: publisher.get_subscription_count() > 0)
    box = trimesh.creation.box((0.021, 0.071, 0.094))
    publisher.publish(mesh_message(box.vertices, box.faces[:1]))  # a triangle is no body
    wait(lambda: client.value("object") == "bad")
    answer = client.call("start")
    assert (answer.success, answer.code) == (False, "BAD_OBJECT")
    publisher.publish(mesh_message(box.vertices, box.faces))
    wait(lambda: client.value("object") == "ready")
    number = start_when_ready(client, "start_with", seed=3).run
    wait(lambda: client.solutions(number))
    client.call("stop")
    # A parameter of one run wins over the topic, and is asked for until it has been read.
    answers = []

    def started():
        made = {"object__vertices": box.vertices.ravel().tolist()}
        made["object__triangles"] = box.faces.ravel().tolist()
        answers.append(client.call("start_with", **made))
        return answers[-1].success

    wait(started)
    assert {answer.code for answer in answers[:-1]} <= {"NOT_READY"}
    client.call("stop")
    client.drop(client.destroy_publisher, publisher)


def test_a_robot_that_leaves_its_start_ends_the_run(scene, client):
    number = start_when_ready(client, "start_with", time_limit=0.0).run
    wait(lambda: client.state() == "searching" and client.value("run") == number)
    joint, was = "yumi_joint_1_l", scene._positions["yumi_joint_1_l"]
    scene._positions[joint] = was + 0.1
    try:
        wait(lambda: client.state() == "robot_moved")
        assert client.value("code") == "ROBOT_MOVED"
        assert client.value("best_valid") == "false"
        heard = len(client.heard["trajectory"])
        assert client.call("stop").code == "NOT_RUNNING"
        assert len(client.heard["trajectory"]) == heard
    finally:
        scene._positions[joint] = was
    start_when_ready(client, "start_with", time_limit=0.0)
    client.call("stop")


def test_a_second_node_in_a_namespace_keeps_to_itself(scene, client, tmp_path):
    before = start_when_ready(client, "start_with", time_limit=0.0).run
    log = tmp_path / "node.log"
    config = str(share_path("config", "small_crayons_box.yaml"))
    asked = ["-r", "__ns:=/cell", "-r", "points:=/points", "-r", "joint_states:=/joint_states"]
    process = start_node(log, "--params-file", config, *asked)
    try:
        wait(lambda: "ready" in log.read_text() or process.poll() is not None)
        answers = []

        def started():
            request = Trigger.Request()
            response = client.request(Trigger, "start", request, node=f"/cell/{NODE}")
            answers.append(said(response.success, response.message))
            return answers[-1].success

        wait(started)
        assert int(answers[-1].run) > int(before)
        assert client.value("run") == before
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(30.0) == 0, log.read_text()
    assert "Traceback" not in log.read_text()
    assert client.call("stop").run == before


# --- confirming


def test_what_needs_an_idle_planner_is_refused_while_it_searches(scene, client):
    number = start_when_ready(client, "start_with", time_limit=0.0).run
    for service in ("confirm_placed", "clear_environment", "start"):
        answer = client.call(service)
        assert (answer.success, answer.code, answer.run) == (False, "ALREADY_RUNNING", number), (
            service
        )
    answer = client.call("confirm_placed_with", run=int(number), solution=1)
    assert (answer.success, answer.code) == (False, "ALREADY_RUNNING")
    answer = client.call("remove_placed", run=int(number))
    assert (answer.success, answer.code) == (False, "ALREADY_RUNNING")
    wrong = client.call("stop_with", run=int(number) + 1)
    assert (wrong.success, wrong.code) == (False, "WRONG_RUN")
    assert client.state() in ("preparing", "searching")
    answer = client.call("stop_with", run=int(number))
    assert (answer.success, answer.code, answer.run) == (True, "OK", number)


def test_any_solution_of_the_last_run_can_be_confirmed_and_removed(scene, client):
    number = start_when_ready(client, "start_with", seed=3).run
    wait(lambda: client.last_solution(number) >= 2)
    client.call("stop")
    run = int(number)
    assert client.call("confirm_placed_with", run=run - 1, solution=1).code == "WRONG_RUN"
    assert client.call("confirm_placed_with", run=run, solution=10_000).code == "BAD_PARAMETER"
    short = client.call("confirm_placed_with", run=run, solution=1, pose=[0.0] * 3)
    assert short.code == "BAD_PARAMETER"
    assert "pose" in short.words
    millimetres = [500.0, 0.0, 300.0, 0.0, 0.0, 0.0, 1.0]
    far = client.call("confirm_placed_with", run=run, solution=1, pose=millimetres)
    assert (far.code, "give metres" in far.words) == ("BAD_PARAMETER", True)
    assert client.call("confirm_placed_with", run=run, solution=1).code == "OK"
    wait(lambda: client.value("placed") == number)
    assert client.value("best_valid") == "false"
    pose = [0.5, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0]
    assert client.call("confirm_placed_with", run=run, solution=2, pose=pose).code == "OK"
    wait(lambda: client.value("placed") == number)
    assert client.call("remove_placed", run=run - 1).code == "WRONG_RUN"
    assert client.call("remove_placed", run=run).code == "OK"
    wait(lambda: client.value("placed") == "")
    assert client.call("remove_placed", run=run).code == "WRONG_RUN"
    assert client.call("confirm_placed").code == "OK"
    assert client.call("clear_environment").code == "OK"
    wait(lambda: client.value("placed") == "")


def test_a_late_subscriber_gets_the_newest_of_everything(run, client):
    late = Client("late_reader")
    try:
        wait(lambda: all(late.heard[topic] for topic in PARTS))
        for topic in ("trajectory", "solution"):
            assert late.heard[topic][-1].header == client.heard[topic][-1].header
    finally:
        late.close()
