"""Runs from their number to their end code, and answers whatever happens."""

import threading

import numpy as np
import pytest
from helpers.fakes import TABLE, Bench, ended, placement, started
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.sample_goals.remainder import Cause
from placement_planner_ros.core.stopping import step, stoppable
from placement_planner_ros.ros.run import worker


def placed(b, *offers):
    """A run that has found these and was stopped; its number."""
    planner = started(b)
    planner.offers += offers
    b.wait(lambda: b.manifests()[-1]["solution"] == str(len(offers)))
    return int(b.call("stop").run)


# --- numbers


def test_numbers_grow_over_the_lives_of_nodes(ros):
    numbers = []
    for _ in range(2):
        b = Bench(first_run=None)
        try:
            for _ in range(2):
                planner = started(b)
                numbers.append(b.node._commands.run.number)
                planner.offers.append(0.1)
                key = f"{numbers[-1]}/1"
                b.wait(lambda b=b, key=key: b.messages("trajectory")[-1].header.frame_id == key)
                assert b.call("stop_with", run=numbers[-1]).run == str(numbers[-1])
        finally:
            b.close()
    assert numbers == sorted(set(numbers))
    assert 0 < numbers[0] < numbers[-1] < 2**53


# --- what was placed


def near(snapshot, x):
    """How many points of the snapshot are where a box placed at (x, 0, 0.1) has its surface."""
    points = np.vstack(snapshot.clouds)[len(TABLE) :]
    return int((np.abs(points[:, 0] - x) < 0.048).sum())


def test_any_solution_of_the_last_run_can_be_confirmed(bench):
    b = bench()
    b.feed()
    assert b.call("confirm_placed_with", run=0, solution=1).code == "WRONG_RUN"
    run = placed(b, placement(0.1, x=0.3), placement(0.2, x=0.5), placement(0.3, x=0.7))
    assert b.call("confirm_placed_with", run=run + 1, solution=1).code == "WRONG_RUN"
    assert b.status()["placed"] == ""
    answer = b.call("confirm_placed_with", run=run, solution=2)
    assert (answer.code, answer.run) == ("OK", str(run))
    b.wait(lambda: b.status()["placed"] == str(run))
    assert b.status()["best_valid"] == "false"
    started(b)
    assert [near(b.snapshots[-1], x) > 0 for x in (0.3, 0.5, 0.7)] == [False, True, False]
    for service in ("confirm_placed", "clear_environment", "start"):
        assert b.call(service).code == "ALREADY_RUNNING"
    assert b.call("confirm_placed_with", run=run, solution=1).code == "ALREADY_RUNNING"
    assert b.call("remove_placed", run=run).code == "ALREADY_RUNNING"


def test_a_repeat_replaces_and_a_measured_pose_counts(bench):
    b = bench()
    run = placed(b, placement(0.1, x=0.3), placement(0.2, x=0.5))
    assert b.call("confirm_placed").code == "OK"
    assert b.call("confirm_placed_with", run=run, solution=1).code == "OK"
    half = float(np.sqrt(0.5))
    pose = [0.7, 0.0, 0.1, 0.0, 0.0, half, half]
    assert b.call("confirm_placed_with", run=run, solution=1, pose=pose).code == "OK"
    started(b)
    b.call("stop")
    added = np.vstack(b.snapshots[-1].clouds)[len(TABLE) :]
    # The box, turned by a quarter: what was its extent in x is the one in y.
    np.testing.assert_allclose(added.min(axis=0), [0.6895, -0.047, 0.0645], atol=1e-6)
    np.testing.assert_allclose(added.max(axis=0), [0.7105, 0.047, 0.1355], atol=1e-6)


def test_what_cannot_be_confirmed_is_named(bench):
    b = bench()
    run = placed(b, 0.1, 0.2)
    for changes in (
        {"solution": 3},
        {"solution": 1.0},
        {"solution": None},
        {"run": True},
        {"pose": [0.0] * 6},
        {"pose": [5000.0, 0.0, 300.0, 0.0, 0.0, 0.0, 1.0]},
        {"pose": [float("nan"), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]},
        {"poses": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]},
    ):
        given = {"run": run, "solution": 1} | changes
        answer = b.call("confirm_placed_with", **{n: v for n, v in given.items() if v is not None})
        assert (answer.success, answer.code) == (False, "BAD_PARAMETER")
        assert next(iter(changes)) in answer.words
    assert not b.node._inputs.known.placed


def test_what_was_placed_can_be_taken_away(bench):
    b = bench()
    first = placed(b, placement(0.1, x=0.3))
    assert b.call("remove_placed", run=first).code == "WRONG_RUN"
    b.call("confirm_placed")
    second = placed(b, placement(0.1, x=0.5))
    b.call("confirm_placed")
    b.wait(lambda: b.status()["placed"] == f"{first} {second}")
    assert b.call("remove_placed", run=first).code == "OK"
    b.wait(lambda: b.status()["placed"] == str(second))
    answer = b.call("remove_placed", run=first)
    assert (answer.success, answer.code) == (False, "WRONG_RUN")
    assert str(second) in answer.words
    assert b.call("remove_placed").code == "BAD_PARAMETER"
    started(b)
    assert [near(b.snapshots[-1], x) > 0 for x in (0.3, 0.5)] == [False, True]
    b.call("stop")
    b.call("clear_environment")
    b.wait(lambda: b.status()["placed"] == "")


# --- ends


def test_a_search_that_is_exhausted_says_by_what(bench):
    b = bench()
    for run, cause in enumerate((*Cause, None), 1):
        planner = started(b)
        planner.exhausted, planner.cause = "there is nothing", cause
        planner.done.set()
        assert ended(b, run, "exhausted")["code"] == (cause or "NO_SOLUTION")


def test_an_end_with_a_solution_is_ok_and_one_without_is_not(bench):
    b = bench()
    for number, offers in enumerate(([], [0.1])):
        planner = started(b, time_limit=0.0)
        planner.offers += offers
        b.wait(lambda offers=offers: b.manifests()[-1]["solution"] == str(len(offers)))
        assert b.call("stop").code == "OK"
        assert ended(b, number + 1, "stopped")["code"] == ("OK" if offers else "NO_SOLUTION")
    planner = started(b)
    planner.offers.append(0.1)
    planner.cause = Cause.UNSUPPORTED
    b.wait(lambda: b.manifests()[-1]["solution"] == "1")
    planner.done.set()
    assert ended(b, 3, "exhausted")["code"] == "OK"


def test_a_robot_that_leaves_its_start_ends_the_run(bench):
    b = bench()
    started(b).offers.append(0.1)
    b.wait(lambda: b.manifests()[-1]["solution"] == "1")
    b.joint_state(yumi_joint_5_l=0.3)
    status = ended(b, 1, "robot_moved")
    assert (status["code"], status["best_valid"]) == ("ROBOT_MOVED", "false")
    assert "the robot has left q_0: yumi_joint_5_l" in b.messages("status")[-1].message


# --- time


def test_preparing_has_a_limit_of_its_own_and_says_what_took_so_long(bench, monkeypatch):
    monkeypatch.setattr(worker, "PREPARING_S", 0.2)
    b = bench()

    def prepare(should_stop):
        with stoppable(should_stop):
            while True:
                step("making the open hand of arm left")

    b.preparing = prepare
    b.feed()
    assert b.call("start").success
    assert ended(b, 1, "failed")["code"] == "NO_SOLUTION"
    said = b.messages("status")[-1].message
    assert "0.2 s" in said
    assert "making the open hand of arm left" in said


# --- faults


class Odd(BaseException):
    pass


def objective_error(value, cause=None):
    """As an objective raises it, or one whose value is none."""
    error = ParameterError("objective", value, "must be finite")
    error.__cause__ = cause
    return error


@pytest.mark.parametrize(
    ("error", "code", "words", "tracebacks"),
    [
        (KeyboardInterrupt(), "BAD_PARAMETER", "KeyboardInterrupt", 1),
        (Odd("odd"), "BAD_PARAMETER", "Odd", 1),
        (objective_error("raised", ZeroDivisionError("odd")), "BAD_PARAMETER", "raised", 1),
        (objective_error("nan"), "BAD_PARAMETER", "nan", 0),
        (ZeroDivisionError("division by zero"), "INTERNAL", "division by zero", 1),
    ],
    ids=str,
)
def test_whatever_is_raised_ends_its_run_only(bench, capfd, error, code, words, tracebacks):
    b = bench()
    started(b).error = error
    assert ended(b, 1, "failed")["code"] == code
    said = b.messages("status")[-1].message
    assert words in said
    assert words in b.status()["why"]
    assert "objective" in said or code == "INTERNAL"
    assert b.call("stop").code == "NOT_RUNNING"
    started(b).offers.append(0.1)
    b.wait(lambda: b.manifests()[-1]["solution"] == "1")
    assert capfd.readouterr().err.count("Traceback") == tracebacks


def raising(error):
    def raises(*_):
        raise error

    return raises


def test_a_command_that_raises_is_answered(bench, capfd, monkeypatch):
    b = bench()
    monkeypatch.setattr(b.node._inputs.clouds, "clear", raising(ZeroDivisionError("broken")))
    answer = b.call("clear_environment")
    assert (answer.success, answer.code) == (False, "INTERNAL")
    assert "broken" in answer.words
    assert capfd.readouterr().err.count("Traceback") == 1
    monkeypatch.setattr(b.node._inputs.clouds, "clear", raising(SystemExit(1)))
    assert b.call("clear_environment").code == "INTERNAL"
    monkeypatch.setattr(b.node._inputs.clouds, "clear", raising(ParameterError("x", 1, "y")))
    assert b.call("clear_environment").code == "BAD_PARAMETER"


def test_setting_parameters_is_answered_whatever_happens(bench, monkeypatch):
    b = bench()
    client = b.client.create_client(SetParameters, "placement_planner/set_parameters")
    assert client.wait_for_service(120.0)

    def set_(*messages):
        future = client.call_async(SetParameters.Request(parameters=list(messages)))
        b.wait(future.done)
        return future.result().results

    odd = ParameterMessage(name="seed", value=ParameterValue(type=77))
    good = Parameter("seed", value=3).to_parameter_msg()
    results = set_(good, odd)
    assert [r.successful for r in results] == [False, False]
    assert "BAD_PARAMETER" in results[0].reason
    monkeypatch.setattr(b.node._settings, "check", raising(ZeroDivisionError("broken")))
    results = set_(good)
    assert [r.successful for r in results] == [False]
    assert "INTERNAL" in results[0].reason
    monkeypatch.undo()
    assert set_(good)[0].successful


def test_a_start_beyond_the_limits_is_refused_and_one_bad_arm_is_a_note(bench):
    b = bench()
    b.feed()

    def at(**joints):
        b.joint_state(**joints)
        return b.call("start")

    left, both = {"yumi_joint_6_l": 4.05}, {"yumi_joint_6_l": 4.05, "yumi_joint_6_r": 4.05}
    answers = []

    def refused():
        before = b.node._commands.run  # an answer may still be of the joints of before
        answers.append(at(**both))
        return answers[-1].code == "BAD_START" and b.node._commands.run is before

    b.wait(refused)
    assert not answers[-1].success
    assert "yumi_joint_6_l = 4.05 is" in answers[-1].words
    assert "yumi_joint_6_r = 4.05 is" in answers[-1].words
    b.wait(lambda: answers.append(at(**left)) or answers[-1].code == "OK")
    assert "does without left: beyond the joint limits: joint yumi_joint_6_l" in answers[-1].words


# --- ~/occupancy


def test_the_occupancy_is_that_of_the_run_also_after_a_stop(bench):
    b = bench()
    started(b)
    b.call("stop")
    b.wait(lambda: b.messages("occupancy") and b.messages("occupancy")[-1].width > 0)


def test_a_run_that_is_prepared_has_no_occupancy_and_is_stopped_at_once(bench):
    b = bench()
    go_on = threading.Event()
    b.preparing = lambda _: go_on.wait(60.0)  # and looks at nothing
    b.feed()
    assert b.call("start").success
    b.wait(lambda: b.messages("occupancy")[-1].width == 0)
    assert b.call("stop").code == "OK"
    assert ended(b, 1, "stopped")["code"] == "NO_SOLUTION"
    assert b.call("start").run == "2"
    go_on.set()
