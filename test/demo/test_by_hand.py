"""The commands that the demonstration shows at its end can be typed as they stand."""

import ast
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from placement_planner_ros.demo import by_hand as module
from placement_planner_ros.demo.by_hand import by_hand
from placement_planner_ros.demo.setting import bundled


@pytest.fixture(scope="module")
def setting():
    return bundled("table", "wine_glass")


@pytest.fixture
def environment(tmp_path, monkeypatch):
    """An environment like that of `make`, in the current folder; nothing of it is on the path."""
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    for name in ("python", "placement_scene", "placement_planner"):
        (programs / name).write_text("#!/bin/sh\n")
        (programs / name).chmod(0o755)
    monkeypatch.setattr(module.sys, "executable", str(programs / "python"))
    monkeypatch.setenv("PATH", "/usr/bin:/bin")
    monkeypatch.chdir(tmp_path)
    return programs


def programs_of(commands):
    return [shlex.split(each)[0] for each in commands]


def test_programs_have_their_path_where_no_shell_finds_them(setting, environment):
    commands = by_hand(setting, ["-p", "target_volume:=[0, 1]"])
    assert programs_of(commands) == [
        ".venv/bin/placement_scene",
        ".venv/bin/placement_planner",
        ".venv/bin/python",
    ]
    for each in programs_of(commands):
        assert shutil.which(each)
    assert "'target_volume:=[0, 1]'" in commands[1]


def test_programs_have_their_name_where_a_shell_finds_them(setting, environment, monkeypatch):
    monkeypatch.setenv("PATH", str(environment))
    assert programs_of(by_hand(setting, [])) == ["placement_scene", "placement_planner", "python"]


def test_from_elsewhere_the_path_is_a_whole_one(setting, environment, monkeypatch):
    (elsewhere := environment / "elsewhere").mkdir()
    monkeypatch.chdir(elsewhere)
    assert programs_of(by_hand(setting, []))[0] == str(environment / "placement_scene")


def test_the_question_is_python_that_needs_no_ros_command(setting):
    _, _, asking = by_hand(setting, [])
    _, flag, code = shlex.split(asking)
    assert flag == "-c"
    ast.parse(code)
    assert "PlacementClient" in code
    assert Path(sys.executable).exists()
