"""Programs asked for help say what they are for, and end."""

import sys

import pytest

from placement_planner_ros import __main__ as programs


@pytest.mark.parametrize("flag", ["-h", "--help"])
@pytest.mark.parametrize("name", ["placement_planner", "placement_scene"])
def test_help_is_printed_and_nothing_is_started(name, flag, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [name, flag])
    monkeypatch.setattr(programs, "import_module", lambda module: pytest.fail(f"{module} started"))
    assert getattr(programs, name)() is None
    assert f"usage: {name} " in capsys.readouterr().out
