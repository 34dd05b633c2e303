"""What a client says of placements that were carried out, and whether one still holds."""

import threading

import pytest
from geometry_msgs.msg import Point, Pose, Quaternion
from helpers.fakes import TABLE
from helpers.searches import Doing, found, searching

from placement_planner_ros.client import PlacementError
from placement_planner_ros.ros.run import watch


@pytest.fixture
def solution(fed, planner):
    """The second of two that a run has found."""
    placing = Doing(lambda: planner.place({}, 600.0, until=lambda s: s.number == 2))
    found(fed, 0.25, x=0.3)
    found(fed, 0.5, x=0.4)
    return placing.result


def test_what_was_placed_becomes_part_of_the_environment_and_is_taken_away(fed, planner, solution):
    assert planner.confirm_placed(solution) == solution.run
    assert list(fed.node._inputs.known.placed) == [solution.run]
    planner.remove_placed(solution)
    assert not fed.node._inputs.known.placed
    with pytest.raises(PlacementError) as raised:
        planner.remove_placed(solution.run)
    assert (raised.value.code, raised.value.run) == ("WRONG_RUN", solution.run)
    planner.confirm_placed(solution)
    planner.clear_environment()
    assert not fed.node._inputs.known.placed


def test_another_solution_is_confirmed_where_it_was_measured(fed, planner, solution, monkeypatch):
    confirmed = []
    monkeypatch.setattr(fed.node._inputs, "confirm", lambda run, body, pose: confirmed.append(pose))
    measured = Pose(position=Point(x=0.35, y=0.1, z=0.2), orientation=Quaternion(z=1.0, w=0.0))
    planner.confirm_placed(solution)
    planner.confirm_placed(solution, pose=measured)
    assert [pose.translation[0] for pose in confirmed] == [0.4, 0.35]
    assert confirmed[1].rotation[0, 0] == pytest.approx(-1.0)
    with pytest.raises(PlacementError, match="pose"):
        planner.confirm_placed(solution, pose=Pose(orientation=Quaternion(w=0.0)))


def test_validity_follows_the_node(fed, planner, solution):
    assert solution.validity
    fed.sensors.move(0.2)
    fed.wait(lambda: not planner.validity(solution))
    assert "left q_0: yumi_joint_" in planner.validity(solution).reason
    assert solution.validity, "it was handed out so"
    fed.sensors.changes = {}
    fed.wait(lambda: planner.validity(solution))
    planner.confirm_placed(solution)
    fed.wait(lambda: not planner.validity(solution))
    assert "carried out" in planner.validity(solution).reason


def test_a_solution_is_handed_out_once_newer_clouds_were_looked_at(fed, planner, monkeypatch):
    go_on, make = threading.Event(), watch.way_of
    monkeypatch.setattr(watch, "way_of", lambda *of: make(*of) if go_on.wait(600.0) else None)
    heard = []
    placing = Doing(lambda: planner.place({}, 600.0, until=heard.append))
    searching(fed)
    updates = fed.node._inputs.clouds.updates
    fed.cloud(TABLE + 1e-4)
    fed.wait(lambda: fed.node._inputs.clouds.updates > updates)
    found(fed, 0.25)
    fed.wait(lambda: heard)
    assert not heard[0].validity.known
    assert not heard[0].validity
    fed.planners[0].done.set()
    fed.wait(lambda: planner.status.state == "exhausted")
    now = planner.validity(heard[0])
    assert (bool(now), now.known) == (False, False)
    assert placing.is_alive()
    go_on.set()
    assert placing.result.validity
    assert placing.result.validity.known
