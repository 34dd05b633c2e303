"""Programs asked for help, or something they do not know, say what they are for, and end."""

import sys

import pytest

from placement_planner_ros import __main__ as programs


@pytest.mark.parametrize("flag", ["-h", "--help", "--params-file"])
@pytest.mark.parametrize("name", ["placement_planner", "placement_scene"])
def test_help_is_printed_and_nothing_is_started(name, flag, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [name, flag])
    monkeypatch.setattr(programs, "import_module", lambda module: pytest.fail(f"{module} started"))
    with pytest.raises(SystemExit) as ended:
        getattr(programs, name)()
    asked = flag != "--params-file"
    assert (f"usage: {name} " in capsys.readouterr().out) == asked
    assert asked or "goes after --ros-args" in str(ended.value)


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
