"""When the page looks elsewhere and draws anew, without a browser."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pinocchio as pin
import pytest

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
        robot=SimpleNamespace(root="base"),
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


def test_the_camera_stays_until_robot_or_volume_are_others(page):
    assert looks(page) == 1
    page._listener.positions = {"j": 0.7}
    page._world.known["target_volume"] = [*V[:5], V[5] + 1e-6]  # as it is published
    assert looks(page) == 0
    page._world.known["target_volume"] = [*V[:5], V[5] + 0.1]
    assert looks(page) == 1
    page._world.robot = SimpleNamespace(root="base")
    assert looks(page) == 1


def test_the_camera_looks_at_the_volume_and_the_robot_faces_it(page):
    page._look()
    eye, at = page._stage.look_from.call_args.args
    assert at == pytest.approx([0.45, 0.0, 0.15])
    assert (eye - at)[0] > 0.2  # beyond V, as the robot sees it
    assert (eye - at)[2] > 0.2
