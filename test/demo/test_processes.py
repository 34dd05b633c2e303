"""Processes of the demonstration."""

import sys
from pathlib import Path

import placement_planner_ros
from placement_planner_ros.demo import processes


def test_a_package_in_the_current_folder_is_not_taken_for_the_one_that_runs(tmp_path, monkeypatch):
    other = tmp_path / "placement_planner_ros"
    other.mkdir()
    (other / "__init__.py").write_text("")
    monkeypatch.chdir(tmp_path)
    log = tmp_path / "log"
    program = "import placement_planner_ros; print(placement_planner_ros.__file__)"
    with processes._running([sys.executable, "-c", program], log) as process:
        assert process.wait() == 0
    assert Path(log.read_text().strip()) == Path(placement_planner_ros.__file__)
