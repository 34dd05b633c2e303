"""The real node as a process of its own, used as a user would."""

import contextlib
import re
import resource
import signal
from pathlib import Path

import numpy as np
from helpers.fakes import values_of
from helpers.published import pose_of, solution_of, task_of
from helpers.system import NODE, OBJECT, PARTS, SCENE, Client, start_node, start_when_ready, wait
from helpers.tasks import yumi_checker
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, ListParameters
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

INPUTS = {
    "/points": "sensor_msgs/msg/PointCloud2",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/robot_description": "std_msgs/msg/String",
    f"/{NODE}/object": "shape_msgs/msg/Mesh",
}
STATUS_KEYS = {
    *("run", "state", "code", "robot", "object", "placed", "warm", "solutions", "samples"),
    *("objective", "best_valid", "best_invalid_reason"),
}


def test_topics_have_their_types_and_are_latched(client):
    types = dict(client.get_topic_names_and_types())
    for topic, kind in PARTS.items():
        package = kind.__module__.partition(".")[0]
        assert types[f"/{NODE}/{topic}"] == [f"{package}/msg/{kind.__name__}"]
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


def test_every_parameter_has_words_and_every_number_a_range(client):
    listed = client.request(ListParameters, "list_parameters", ListParameters.Request())
    request = DescribeParameters.Request(names=list(listed.result.names))
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


def test_all_threads_share_one_heap(node, client):
    """glibc reserves 64 MB for the heap of another thread, of which most is not to be used yet."""
    lines = [line.split() for line in Path(f"/proc/{node.pid}/maps").read_text().splitlines()]
    ends = [[int(end, 16) for end in line[0].split("-")] for line in lines if line[1] == "---p"]
    assert not [end for start, end in ends if end % 2**26 == 0 and end - start > 2**24]


def test_a_user_gets_placements_and_stops(scene, client):
    answer = start_when_ready(client)
    run = answer.run
    assert (answer.code, 0 < int(run) < 2**63) == ("OK", True)
    again = client.call("start")
    assert not again.success
    assert (again.code, again.run) == ("ALREADY_RUNNING", run)
    wait(lambda: client.last_solution(run) >= 2)

    late = Client("late")
    try:
        wait(lambda: all(late.heard[topic] for topic in PARTS))
    finally:
        late.close()
    assert late.heard["trajectory"][0].points

    answer = client.call("stop")
    assert answer.success
    line = rf"code=OK run={run} solution=\d+ objective=-?[\d.e-]+"
    assert re.fullmatch(line, answer.text.splitlines()[0])
    wait(lambda: client.state() == "stopped")
    wait(lambda: client.last_solution(run) == int(answer.solution))
    objectives = [float(m["objective"]) for m in client.solutions(run)]
    assert objectives == sorted(set(objectives))
    assert float(answer.objective) == objectives[-1]
    statuses = [values_of(m) for m in client.heard["status"] if values_of(m)["run"] == run]
    order = ["preparing", "searching", "stopping", "stopped"]
    ranks = [order.index(status["state"]) for status in statuses]
    assert ranks == sorted(ranks)
    assert set(statuses[-1]) >= STATUS_KEYS
    assert [statuses[-1][key] for key in ("code", "robot", "object")] == ["OK", "ready", "ready"]
    check_last_solution(client, run, answer.solution)


def check_last_solution(client, run, solution, objective="maximize_clearance", placed=()):
    """The parts of the last solution belong together and pass the independent checker.

    Args:
        placed: poses at which such an object stands already.

    Returns:
        The pose of this one.
    """
    key = f"{run}/{solution}"
    wait(lambda: client.heard["trajectory"][-1].header.frame_id == key)
    manifest = client.solutions(run)[-1]
    message, pose = client.heard["trajectory"][-1], client.heard["placement_pose"][-1]
    retreat = client.heard["retreat_trajectory"][-1]
    assert retreat.header.frame_id == key
    assert manifest["has_retreat"] == "true"
    assert retreat.joint_names == message.joint_names
    np.testing.assert_allclose(retreat.points[0].positions, message.points[-1].positions, atol=1e-9)
    assert pose.header.stamp == client.heard["solution"][-1].header.stamp
    # words have six digits, the topic has all
    assert f"{client.heard['objective'][-1].data:.6g}" == manifest["objective"]
    found = solution_of(OBJECT, manifest, message, retreat, pose)
    task = task_of(SCENE, OBJECT, objective, placed)
    assert yumi_checker(task).check(found) == []
    return pose_of(pose)


def test_a_placed_object_is_obstacle_and_support_for_the_next(scene, client):
    """Two of a kind, close to what stands there: the second among the scene and the first."""
    placed = []
    for _ in range(2):
        run = start_when_ready(client, "start_with", objective="minimize_clearance", seed=1).run
        wait(lambda run=run: client.last_solution(run) >= 2)
        answer = client.call("stop")
        wait(lambda run=run, last=answer.solution: client.last_solution(run) == int(last))
        placed.append(
            check_last_solution(client, run, answer.solution, "minimize_clearance", placed)
        )
        assert client.call("confirm_placed").success
    assert client.call("clear_environment").success


@contextlib.contextmanager
def limited(node, kind, limit):
    """The node's process under a limit that it has not begun with."""
    before = resource.prlimit(node.pid, kind)
    resource.prlimit(node.pid, kind, (limit, before[1]))
    try:
        yield
    finally:
        resource.prlimit(node.pid, kind, before)


def a_run_goes_well(client):
    run = start_when_ready(client, "start_with", time_limit=0).run
    wait(lambda: client.solutions(run))
    return client.call("stop").code == "OK"


def test_without_memory_a_run_fails_with_a_code_and_the_next_one_goes_well(scene, client, node):
    assert a_run_goes_well(client)
    status = Path(f"/proc/{node.pid}/status").read_text()
    used = int(status.partition("VmData:")[2].split()[0]) * 1024
    with limited(node, resource.RLIMIT_DATA, used + 50_000_000):
        run = start_when_ready(client, "start_with", cloud__cell_size=0.003).run
        wait(lambda: client.value("run") == run and client.state() == "failed")
        assert client.value("code") == "INTERNAL"
        words = client.call("stop").words
        assert "not enough memory" in words
        assert "cloud.cell_size" in words
    assert a_run_goes_well(client)


def test_where_no_file_can_grow_a_run_goes_well(scene, client, node):
    with limited(node, resource.RLIMIT_FSIZE, 0):  # as on a full disk: nor can the log
        assert a_run_goes_well(client)
        assert client.call("start_with", seed="many").code == "BAD_PARAMETER"


def test_two_interrupts_end_the_node_as_one_does(scene, client, node):
    for _ in range(2):
        node.send_signal(signal.SIGINT)
    assert node.wait(120.0) == 0


def test_a_bad_parameter_at_start_up_is_named(tmp_path):
    log = tmp_path / "node.log"
    assert start_node(log, "-p", "sampler:=magic").wait(120.0) != 0
    assert "sampler = 'magic': choose one of optimistic, mcts, uniform" in log.read_text()
    assert "Traceback" not in log.read_text()
