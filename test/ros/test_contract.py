"""What users rely on, message by message, asked of the real node in a process of its own."""

import re
import signal

import pytest
from helpers.fakes import said, values_of
from helpers.system import NODE, start_node, start_when_ready, wait
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, ListParameters
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from std_srvs.srv import Trigger

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


# --- one run


def test_the_first_line_of_an_answer_is_for_machines(run, client):
    number, stopped = run
    line = stopped.text.splitlines()[0]
    assert re.fullmatch(r"code=OK run=\d+ solution=\d+ objective=-?[\d.e-]+", line)
    assert 0 < int(number) < 2**63
    answer = client.call("stop")
    assert answer.success
    assert answer.text.splitlines()[0].startswith("code=NOT_RUNNING")


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


# --- inputs


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
        assert process.wait(120.0) == 0, log.read_text()
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
