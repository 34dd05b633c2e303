"""What passing every stage took is kept, and loaded by the next process instead."""

import json
import subprocess
import sys

import pytest

from placement_planner_ros.core import disk_cache
from placement_planner_ros.core.disk_cache import seal_content, stored_result, unseal_content
from placement_planner_ros.core.warmup import passing
from placement_planner_ros.core.warmup.known_task import KnownTask
from placement_planner_ros.core.warmup.passing import load_passed
from placement_planner_ros.core.warmup.warm_up import load_kernels

PROGRAM = """
import json
from placement_planner_ros.core import kernel_cache
from placement_planner_ros.core.warmup.known_task import STAGES, KnownTask
from placement_planner_ros.core.warmup.warm_up import load_kernels

solved = []
solve = KnownTask.solve
KnownTask.solve = lambda *given: solved.append(1) or solve(*given)
load_kernels()
loaded = kernel_cache.kernel_versions("")
solve(KnownTask(), STAGES[::-1])
print(json.dumps([len(solved), len(loaded), kernel_cache.kernel_versions("") == loaded]))
"""


@pytest.fixture(scope="module")
def kept():
    """The file that says which kernels there were in the end."""
    load_kernels()
    path = passing._passed_file()
    assert path.is_file()
    return path


@pytest.fixture
def of_its_own(kept, tmp_path, monkeypatch):
    """A copy, for this test alone; kernels stay where they are."""
    path = tmp_path / kept.name
    path.write_bytes(kept.read_bytes())
    monkeypatch.setattr(passing, "_passed_file", lambda: path)
    monkeypatch.setattr(passing, "forget_all", lambda: None)
    return path


def test_the_next_process_has_the_same_kernels_without_passing_any_stage(kept):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    solved, loaded, same = json.loads(done.stdout)
    assert solved == 0
    assert loaded > 1000
    assert same


@pytest.mark.parametrize("damage", [lambda _: b"", lambda whole: whole[:-5] + b"other"])
def test_where_it_is_damaged_every_stage_is_passed(of_its_own, monkeypatch, damage):
    assert load_passed()
    whole = of_its_own.read_bytes()
    of_its_own.write_bytes(damage(whole))
    assert not load_passed()
    passed = []
    monkeypatch.setattr(KnownTask, "solve", lambda *given: passed.append(given))
    load_kernels.__wrapped__()
    assert len(passed) == 1
    assert load_passed()


def test_a_kernel_that_there_is_not_any_more_is_no_reason_to_fail(of_its_own):
    whole = unseal_content(of_its_own.read_bytes(), of_its_own.name)
    gone = whole.replace(b"check_states", b"check_stages")
    assert gone != whole
    of_its_own.write_bytes(seal_content(gone, of_its_own.name))
    assert not load_passed()
    assert not of_its_own.exists()


def test_without_a_home_it_is_not_kept(monkeypatch):
    monkeypatch.setattr(passing, "cache_folder", lambda: None)
    assert passing._passed_file() is None
    assert not load_passed()


def test_a_change_of_any_file_of_the_core_makes_it_another(tmp_path, monkeypatch, kept):
    (tmp_path / "planner.py").write_text("")
    monkeypatch.setattr(passing, "_CORE", tmp_path)
    one = passing._passed_file()
    (tmp_path / "planner.py").write_text("changed = True")
    assert len({kept, one, passing._passed_file()}) == 3


def test_what_is_on_disk_is_made_anew_so_that_what_makes_it_is_passed(kept, monkeypatch, tmp_path):
    monkeypatch.setattr(passing, "_passed_file", lambda: tmp_path / "passed")
    made = []
    monkeypatch.setattr(
        KnownTask, "solve", lambda *_: made.append(stored_result("rows", "key", lambda: "anew"))
    )
    monkeypatch.setattr(disk_cache, "cache_folder", lambda: tmp_path)
    stored_result("rows", "key", lambda: "kept")
    passing.pass_every_stage()
    assert made == ["anew"]
    assert stored_result("rows", "key", str) == "kept"
