"""When the page looks elsewhere and draws anew, without a browser."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pinocchio as pin
import pytest

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
