"""Programs asked for help say what they are for, and end."""

import re
import sys

import numpy as np
import pytest

from placement_planner_ros import __main__ as programs
from placement_planner_ros.ros.tools import scene_publisher
from placement_planner_ros.ros.tools.scene_publisher import ScenePublisher
from placement_planner_ros.scenes.objects import BUNDLED_OBJECTS
from placement_planner_ros.scenes.scenes import BUNDLED_SCENES


@pytest.mark.parametrize("flag", ["-h", "--help"])
@pytest.mark.parametrize("name", ["placement_planner", "placement_scene"])
def test_help_is_printed_and_nothing_is_started(name, flag, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [name, flag])
    monkeypatch.setattr(programs, "import_module", lambda module: pytest.fail(f"{module} started"))
    assert getattr(programs, name)() is None
    assert f"usage: {name} " in capsys.readouterr().out


def test_the_help_of_the_page_needs_neither_ros_nor_viser(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["placement_view", "--help"])
    monkeypatch.setitem(sys.modules, "rclpy", None)
    monkeypatch.setitem(sys.modules, "viser", None)
    assert programs.placement_view() is None
    said = capsys.readouterr().out
    assert said.startswith("usage: placement_view ")
    assert "127.0.0.1" in said
    monkeypatch.setattr(sys, "argv", ["placement_view"])
    monkeypatch.delitem(sys.modules, "placement_planner_ros.view.command", raising=False)
    monkeypatch.setattr(programs, "catch_signals", lambda: None)
    with pytest.raises(SystemExit, match=r"viser|rclpy") as ended:
        programs.placement_view()
    assert "pip install 'placement_planner_ros[ros,view]'" in str(ended.value)


def test_the_scenes_help_names_all_that_can_be_chosen(monkeypatch, capsys, ros):
    monkeypatch.setattr(sys, "argv", ["placement_scene", "--help"])
    programs.placement_scene()
    said = capsys.readouterr().out
    monkeypatch.setattr(scene_publisher, "complete_cloud", lambda scene: np.zeros((1, 3)))
    node = ScenePublisher()
    own = node._parameters.keys() - {"use_sim_time", "start_type_description_service"}
    node.destroy_node()
    assert {"name", "object", "clouds", "rate"} <= own
    for word in (*own, *BUNDLED_SCENES, *BUNDLED_OBJECTS):
        assert re.search(rf"\b{word}\b", said), word
    assert max(map(len, said.splitlines())) <= 100
