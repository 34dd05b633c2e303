"""When the page looks elsewhere and draws anew, without a browser."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pinocchio as pin
import pytest
from helpers.view_node import solution, status

from placement_planner_ros.view.robot_shapes import LinkShape

module = pytest.importorskip("placement_planner_ros.view.page", reason="viser is not installed")

V = [0.3, -0.2, 0.0, 0.6, 0.2, 0.3]


@pytest.fixture
def page():
    """One that nothing is drawn for, with what it hears and knows."""
    listener = SimpleNamespace(
        clouds={}, positions={"j": 0.0}, watched=True, faults={}, absent="", parameters=None
    )
    known = {"target_volume": V}
    box = np.array(np.meshgrid([-0.1, 0.1], [-0.1, 0.1], [0.0, 0.5])).reshape(3, -1).T
    world = SimpleNamespace(
        robot=SimpleNamespace(shapes=[LinkShape("base", box, np.zeros((0, 3), int), None)]),
        object=(box, np.zeros((0, 3), int)),
        known=known,
        faults={},
        parameter=lambda name, default: known.get(name, default),
        held=lambda poses: [],
        in_planning_frame=lambda cloud, poses: (cloud, ""),
    )
    made = module.Page(MagicMock(), listener, world)
    made._poses = {"base": pin.SE3.Identity()}
    made._stage = MagicMock()
    return made


def looks(page):
    page._stage.look_from.reset_mock()
    page._look()
    return page._stage.look_from.call_count


def test_the_camera_stays_until_robot_volume_or_topics_are_others(page):
    assert looks(page) == 1
    page._listener.positions = {"j": 0.7}
    page._world.known["target_volume"] = [*V[:5], V[5] + 1e-6]  # as it is published
    assert looks(page) == 0
    page._listener.clouds["points"] = np.full((50, 3), 0.4)
    assert looks(page) == 1
    page._listener.clouds["points"] = np.full((50, 3), 0.1)  # the next one of that topic
    assert looks(page) == 0
    page._world.known["target_volume"] = [*V[:5], V[5] + 0.1]
    assert looks(page) == 1
    page._world.robot = SimpleNamespace(shapes=page._world.robot.shapes)
    assert looks(page) == 1


def test_regions_are_coloured_at_once_for_a_scene_and_in_steps_for_a_placement(page, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(module, "region_colours", lambda *_: None)
    heard = {}

    def draws(state="searching"):
        known = status(solutions=len(heard), state=state)
        page.record.take_status(known, lambda run, number: heard.get(number), {})
        page._stage.draw_regions.reset_mock()
        page._draw_regions()
        return page._stage.draw_regions.call_count

    assert draws() == 1
    heard[1] = solution(1, 0.1, run=7)
    assert draws() == 1  # the first placement, which there is a colour by
    heard[2] = solution(2, 0.2, run=7)
    assert draws() == 0
    now[0] += module.COLOUR_PERIOD + 0.1
    assert draws() == 1
    heard[3] = solution(3, 0.3, run=7)
    assert draws() == 0
    page._obstacles = np.zeros((4, 3))
    assert draws() == 1  # another scene waits for nothing
    heard[4] = solution(4, 0.4, run=7)
    assert draws() == 0
    assert draws("stopped") == 1  # and the end of a run neither
    assert draws("stopped") == 0
