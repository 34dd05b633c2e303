"""Which kernels there were once every stage was passed is kept, and loaded by the next process."""

import pickle

import pytest

from placement_planner_ros.core import disk_cache
from placement_planner_ros.core.disk_cache import stored_result
from placement_planner_ros.core.warmup import loading
from placement_planner_ros.core.warmup.known_task import KnownTask
from placement_planner_ros.core.warmup.loading import load_kernels


@pytest.fixture
def passed(monkeypatch, tmp_path):
    """The file of it, for this test alone, and the stages that are passed: one."""
    monkeypatch.setattr(loading, "passed_file", lambda: tmp_path / "passed")
    passes = []
    monkeypatch.setattr(loading, "STAGES", (lambda task: passes.append(task),))
    monkeypatch.setattr(disk_cache, "cache_folder", lambda: tmp_path)
    return tmp_path / "passed", passes


def test_the_next_process_passes_no_stage(passed):
    path, passes = passed
    load_kernels.__wrapped__()
    assert len(passes) == 1
    assert isinstance(passes[0], KnownTask)
    kept = pickle.loads(path.read_bytes())
    assert kept
    assert all(signatures for _, _, signatures in kept)
    load_kernels.__wrapped__()
    assert len(passes) == 1


def test_what_is_on_disk_is_made_anew_so_that_what_makes_it_is_passed(passed, monkeypatch):
    made = []
    stage = lambda _: made.append(stored_result("rows", "key", lambda: "anew"))  # noqa: E731
    monkeypatch.setattr(loading, "STAGES", (stage,))
    stored_result("rows", "key", lambda: "kept")
    load_kernels.__wrapped__()
    assert made == ["anew"]
    assert stored_result("rows", "key", str) == "kept"
