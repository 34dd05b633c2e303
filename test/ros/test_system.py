"""The real node as a process of its own, used as a user would."""

import contextlib
import resource
import signal
from pathlib import Path

import numpy as np
import pytest
from checker import SolutionChecker, Tolerances
from helpers.fakes import values_of
from helpers.published import pose_of, solution_of, task_of
from helpers.system import OBJECT, PARTS, SCENE, Client, start_node, start_when_ready, wait

from placement_planner_ros.core.timing.trajectory_maker import TimingSettings
from placement_planner_ros.scenes.yumi import load_yumi


def test_before_anything_is_published_start_names_it(client):
    answer = client.call("start")
    assert not answer.success
    assert answer.code == "NO_CLOUD"
    assert "points" in answer.words
    assert "JOINTS_MISSING: robot_description" in answer.words, "whose joints is not known yet"
    assert client.call("stop").code == "NOT_RUNNING"


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
    assert (answer.code, answer.run) == ("OK", run)
    wait(lambda: client.state() == "stopped")
    wait(lambda: client.last_solution(run) == int(answer.solution))
    objectives = [float(m["objective"]) for m in client.solutions(run)]
    assert objectives == sorted(set(objectives))
    assert float(answer.objective) == objectives[-1]
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
    task = task_of(SCENE, OBJECT, objective, placed)
    found = solution_of(OBJECT, manifest, message, retreat, pose)
    limit = TimingSettings().acceleration_limits[0]
    assert SolutionChecker(task, Tolerances(acceleration_limit=limit)).check(found) == []
    return pose_of(pose)


def test_start_with_other_parameters_for_one_run(scene, client):
    answer = start_when_ready(
        client,
        "start_with",
        objective="minimize_clearance",
        arms=["right"],
        time_limit=0,
        trajectory_joints="all",
    )
    run = answer.run
    assert answer.code == "OK"
    wait(lambda: client.solutions(run))
    assert client.solutions(run)[0]["arm"] == "right"
    assert float(client.solutions(run)[0]["objective"]) <= 0.0
    wait(lambda: client.heard["trajectory"][-1].header.frame_id.startswith(f"{run}/"))
    wait(lambda: client.heard["trajectory"][-1].points)
    robot = load_yumi()
    assert set(client.heard["trajectory"][-1].joint_names) == set(robot.joint_names) - set(
        robot.mimics
    )
    assert client.call("stop_with", run=int(run) - 1).code == "WRONG_RUN"
    answer = client.call("stop_with", run=int(run))
    assert (answer.code, answer.run) == ("OK", run)
    cleared = [values_of(m.status[0]) for m in client.heard["solution"]]
    assert [int(m["run"]) for m in cleared if m["solution"] == "0"] == [int(run) - 1, int(run)]


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


@pytest.mark.parametrize("signals", [[signal.SIGINT] * 2, [signal.SIGTERM]])
def test_a_signal_ends_the_node_cleanly(ros_module, tmp_path, signals):
    log = tmp_path / "node.log"
    process = start_node(log)
    wait(lambda: "ready" in log.read_text() or process.poll() is not None)
    for number in signals:
        process.send_signal(number)
    assert process.wait(120.0) == 0, log.read_text()
    assert "Traceback" not in log.read_text()


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("sampler:=magic", "sampler = 'magic': choose one of optimistic, mcts, uniform"),
        ("cloud_topics:=['no topic']", "no topic"),
    ],
)
def test_a_bad_parameter_at_start_up_is_named(tmp_path, value, said):
    log = tmp_path / "node.log"
    assert start_node(log, "-p", value).wait(120.0) != 0
    assert said in log.read_text()
    assert "Traceback" not in log.read_text()
