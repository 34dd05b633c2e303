"""`place` against the real node, whose planner finds what it is told to."""

import math
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from helpers.fakes import FRAME
from helpers.searches import Doing, ended, found, searching

from placement_planner_ros.client import PlacementClient, PlacementError, placement_client
from placement_planner_ros.ros.inputs import object_input
from placement_planner_ros.ros.run import worker

# --- what comes of it


def test_a_solution_has_all_its_parts(fed, planner):
    placing = Doing(lambda: planner.place({"seed": 3}, 600.0, until=lambda s: s.number == 2))
    found(fed, 0.5, 0.75, retreats=True, terms=(("near", -0.25), ("edge", 0.0625)))
    solution = placing.result
    assert (solution.run, solution.number, solution.objective) == (1, 2, 0.75)
    assert (solution.arm, solution.grasp, solution.face) == ("left", 0, 1)
    assert solution.approach_start == 0.5
    assert solution.terms == {"near": -0.25, "edge": 0.0625}
    assert "near -0.25, edge 0.0625" in solution.words
    assert solution.pose.header.frame_id == FRAME
    assert solution.pose.pose.position.x == 0.4
    assert solution.trajectory.header.frame_id == "1/2"
    assert solution.retreat_trajectory.header.frame_id == "1/2"
    first, last = solution.retreat_trajectory.points[0], solution.trajectory.points[-1]
    np.testing.assert_allclose(first.positions, last.positions)
    assert solution.validity
    assert "arm left" in solution.words
    assert fed.snapshots[0].parameters["seed"] == 3
    assert ended(fed)


def test_the_best_is_returned_at_the_deadline(fed, planner, monkeypatch):
    heard = []
    placing = Doing(lambda: planner.place({}, 600.0, until=lambda s: heard.append(s.objective)))
    found(fed, 0.25, 0.5)
    fed.wait(lambda: heard)
    later(monkeypatch, 601.0)
    assert placing.result.objective == 0.5
    assert ended(fed)
    assert fed.node._commands.run.state == worker.State.STOPPED
    assert heard == sorted(heard)


def test_results_of_other_runs_count_for_nothing(fed, planner):
    """What is latched, and what the client has heard of the run before."""
    before = Doing(lambda: planner.place({}, 600.0, until=lambda s: True))
    found(fed, 0.9)
    assert before.result.run == 1
    with PlacementClient() as late:
        late.wait_until_ready(600.0)
        fed.wait(lambda: late.improvement(1) is not None)
        heard = []
        for each, number in ((late, 2), (planner, 3)):
            placing = Doing(
                lambda each=each: each.place({}, 600.0, until=lambda s: heard.append(s.run) or True)
            )
            searching(fed, number)
            found(fed, 0.1, number=number)
            assert placing.result.run == number
        assert heard == [2, 3]


# --- what goes wrong


def test_a_refusal_has_the_nodes_code_and_words(fed, planner):
    with pytest.raises(PlacementError) as raised:
        planner.place({"target_volume": [0.0, 0.0, 0.0, 1.0, 1.0, -1.0]}, 600.0)
    assert raised.value.code == "BAD_VOLUME"
    assert "target_volume" in raised.value.words
    assert str(raised.value).startswith("BAD_VOLUME: ")
    assert fed.planners == []


def test_a_search_without_a_solution_says_why(fed, planner):
    placing = Doing(lambda: planner.place({}, 600.0))
    searching(fed).cause = "OUT_OF_REACH"
    fed.planners[0].exhausted = "nothing is in reach"
    fed.planners[0].done.set()
    assert placing.error.code == "OUT_OF_REACH"
    assert "nothing is in reach" in placing.error.words
    assert placing.error.run == 1


def test_no_solution_by_the_deadline_is_said(fed, planner):
    placing = Doing(lambda: planner.place({}, 0.5))
    assert placing.error.code == "NO_SOLUTION"
    assert "no solution" in placing.error.words
    assert ended(fed)


def test_somebody_elses_run_is_left_alone(fed, planner):
    run = planner.start()
    with PlacementClient() as other, pytest.raises(PlacementError) as raised:
        other.place({}, 10.0)
    assert (raised.value.code, raised.value.run) == ("ALREADY_RUNNING", run)
    assert not ended(fed)


def test_a_node_that_goes_away_is_said(fed, planner):
    placing = Doing(lambda: planner.place({}, math.inf))
    searching(fed)
    fed.node._reporter._closed = True  # it says nothing of its end, as if it had crashed
    fed.sensors.close()
    fed.close()
    assert placing.error.code == "NO_NODE"


@pytest.mark.parametrize("deadline", ["5", -1.0, math.nan, True])
def test_a_deadline_that_is_no_time_to_come_is_named(planner, deadline):
    with pytest.raises(ValueError, match=f"deadline = {deadline!r}: give seconds"):
        planner.place({}, deadline)


def later(monkeypatch, seconds):
    """Have the client take it to be later than it is."""
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + seconds)
    monkeypatch.setattr(placement_client, "time", clock)


# --- what passes by itself


def test_a_robot_that_comes_to_rest_is_waited_for(fed, planner, answers):
    fed.sensors.move(0.2)
    placing = Doing(lambda: planner.place({}, 600.0, until=lambda s: True))
    found(fed, 0.5)
    assert placing.result.run == 1
    assert {each.code for each in answers[:-1]} == {"ROBOT_MOVING"}


def test_what_is_being_read_is_waited_for(fed, planner, answers, monkeypatch):
    gate, solids = threading.Event(), object_input.object_solids

    def slow(body):  # made of every body, also of one that was kept on disk
        gate.wait(600.0)
        return solids(body)

    monkeypatch.setattr(object_input, "object_solids", slow)
    box = trimesh.creation.box((0.021, 0.071, 0.094))
    own = {"object.vertices": box.vertices.ravel(), "object.triangles": box.faces.ravel()}
    placing = Doing(lambda: planner.place(own, 600.0, until=lambda s: True))
    fed.wait(lambda: len(answers) >= 2)
    gate.set()
    found(fed, 0.5)
    assert placing.result.run == 1
    assert {each.code for each in answers[:-1]} == {"NOT_READY"}


def test_what_does_not_pass_by_the_deadline_is_said(fed, planner, answers):
    fed.sensors.move(0.1)
    fed.sensors.close()
    at = iter(np.arange(0.15, 3.0, 0.05))
    placing = Doing(lambda: planner.place({}, 0.5))
    fed.wait(lambda: not placing.is_alive(), again=lambda: fed.joint_state(yumi_joint_5_l=next(at)))
    assert placing.error.code == "ROBOT_MOVING"
    assert str(placing.error).startswith("ROBOT_MOVING: ")
    assert "yumi_joint_5_l" in placing.error.words
    assert {each.code for each in answers} == {"ROBOT_MOVING"}


def test_a_robot_that_moves_has_planning_begin_again_where_it_rests(fed, planner):
    placing = Doing(lambda: planner.place({}, 600.0, until=lambda s: s.objective > 0.6))
    found(fed, 0.5)
    fed.sensors.move(0.2)
    found(fed, 0.7, number=2)
    assert (placing.result.run, placing.result.objective) == (2, 0.7)
    assert fed.snapshots[1].q_start.tolist() != fed.snapshots[0].q_start.tolist()


def test_a_start_waits_for_the_worker_of_the_run_before(fed, planner, answers):
    run = planner.start()
    hanging = searching(fed)
    hanging.deaf = True
    with pytest.raises(PlacementError) as raised:
        planner.stop(run)
    assert raised.value.code == "STOPPING"
    placing = Doing(lambda: planner.place({}, 600.0, until=lambda s: True))
    fed.wait(lambda: len(answers) >= 3)
    hanging.done.set()
    found(fed, 0.5, number=2)
    assert placing.result.run == 2
    assert {each.code for each in answers[1:-1]} == {"STOPPING"}
