"""What nobody uses any more does not stay on disk."""

import os
import time

import numpy as np
import pytest

from placement_planner_ros.core import kept_files
from placement_planner_ros.core.kept_files import UNUSED, found_arrays, keep_arrays, note_used

DAY = 24 * 3600.0


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr(kept_files, "kept_folder", lambda: tmp_path)
    monkeypatch.setattr(kept_files, "_USED", set())
    kept_files._remove_unused.cache_clear()
    return tmp_path


def used(folder, ago, *names):
    """A folder with files of these names, last used so many seconds ago."""
    folder.mkdir(parents=True)
    for path in [*(folder / name for name in names), folder]:
        if path != folder:
            path.write_bytes(b"")
    for path in [*folder.iterdir(), folder]:
        os.utime(path, (time.time() - ago,) * 2)
    return folder


def test_folders_that_nobody_used_for_long_go_and_all_others_stay(cache):
    long_ago = UNUSED + DAY
    gone = [
        used(cache / "old-0123456789abcdef", long_ago, "f-1.a.nbk", "g-2.b.nbk"),
        used(cache / "link-shapes", long_ago, f"{8 * 'abc1'}.shapes"),
    ]
    stay = [
        used(cache / "new-0123456789abcdef", UNUSED - DAY, "f-1.a.nbk"),
        used(cache / "mine-0123456789abcdef", long_ago, "f-1.a.nbk"),
        used(cache / "module_0123", long_ago, "f-1.nbi", "f-1.1.nbc"),
        used(cache / "notes", long_ago, "a.txt", "b.nbk"),
        used(cache / "my-txt", long_ago, "a.txt"),
        used(cache / "nbk", long_ago, "b.nbk"),
        used(cache / "nothing-0123456789abcdef", long_ago),
        used(cache / "sphere-trees", long_ago, f"{8 * 'abc1'}.trees"),
    ]
    os.utime(next((cache / "sphere-trees").iterdir()))  # read since
    note_used(stay[1])
    for path in [*stay[1].iterdir(), stay[1]]:
        os.utime(path, (time.time() - long_ago,) * 2)  # as where the clock was set back
    (cache / "plain.shapes").write_bytes(b"")
    keep_arrays("mesh shapes", b"key", {"a": np.zeros(3)})
    assert found_arrays("mesh shapes", b"key") is not None
    assert {path.name for path in cache.iterdir()} == {
        "plain.shapes",
        "mesh-shapes",
        *(folder.name for folder in stay),
    }
    assert not any(folder.exists() for folder in gone)


def test_the_age_is_told_by_what_else_is_there_and_not_by_the_clock(cache, monkeypatch):
    folder = used(cache / "old-0123456789abcdef", DAY / 2, "f-1.a.nbk")
    before = folder.stat().st_mtime
    monkeypatch.setattr(time, "time", lambda: 1e5)
    note_used(folder)
    assert folder.stat().st_mtime == before
    kept_files._USED.clear()
    monkeypatch.setattr(time, "time", lambda: before + 10 * UNUSED)
    keep_arrays("mesh shapes", b"key", {"a": np.zeros(3)})
    assert folder.is_dir()


def test_use_makes_a_folder_new_once_a_day_and_needs_none(cache):
    folder = used(cache / "old-0123456789abcdef", 2.0 * DAY, "f-1.a.nbk")
    note_used(folder)
    assert folder.stat().st_mtime > time.time() - DAY
    note_used(cache / "none")
    assert not (cache / "none").exists()
