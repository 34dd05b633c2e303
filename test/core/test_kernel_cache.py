"""Kernels on disk: what is damaged is made anew, what cannot be kept is done without."""

import fcntl
import os
import resource
import subprocess
import sys
import threading
from pathlib import Path

import numba
import numpy as np
import pytest

import placement_planner_ros
from placement_planner_ros.core import disk_cache, kernel_cache, kernels

ROOT = Path(placement_planner_ros.__file__).parents[1]
PROGRAM = """
from placement_planner_ros.core.disk_cache import TROUBLES
from placement_planner_ros.core.kernels import kernel

TROUBLES.listen(print)

@kernel()
def twice(x):
    return 2 * x

@kernel()
def thrice(x):
    return x + twice(x)

print(thrice(2), thrice(0.5))
print(sum(k.stats.cache_hits.total() for k in (twice, thrice)))
"""


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """An empty cache; what is said of it is in `cache.said`."""
    kernels._cache_folder.cache_clear()
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    troubles, said = disk_cache.Troubles(), []
    troubles.listen(said.append)
    monkeypatch.setattr(kernel_cache, "TROUBLES", troubles)
    monkeypatch.setattr(kernels, "TROUBLES", troubles)
    yield Cache(tmp_path / "cache", said)
    kernels._cache_folder.cache_clear()


class Cache:
    def __init__(self, folder, said):
        self.folder = folder
        self.said = said

    @property
    def files(self):
        return sorted(self.folder.rglob("*.nbk"))


def total(numbers, factor):
    result = 0.0
    for number in numbers:
        result += factor * number
    return result


def call():
    """A kernel as a process that has just begun sees it; whether it was there already."""
    made = kernels.kernel()(total)
    assert made(np.ones(3), 2) == 6.0
    return made.stats.cache_hits.total() == 1


def other_make(_, name):
    """Whole, but of something that has another form."""
    return kernel_cache._packed_parts(("not", "a", "kernel"), name)


DAMAGES = {
    "empty": lambda content, _: b"",
    "half": lambda content, _: content[: len(content) // 2],
    "a flipped bit": lambda content, _: content[:-9] + bytes([content[-9] ^ 1]) + content[-8:],
    "another make": other_make,
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_kernel_is_made_anew_and_that_is_said_once(cache, damage):
    assert not call()
    assert call()
    (file,) = cache.files
    whole = file.read_bytes()
    for _ in range(2):
        file.write_bytes(DAMAGES[damage](whole, file.name))
        assert not call()
        assert call()
    assert len(cache.said) == 1
    assert str(file) in cache.said[0]
    assert "damaged" in cache.said[0]
    assert cache.files == [file]


def test_kernels_that_were_swapped_are_not_taken_for_each_other(cache):
    made = kernels.kernel()(total)
    made(np.ones(3), 2)
    made(np.ones(3), 2.0)
    one, other = cache.files
    content = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(content)
    again = kernels.kernel()(total)
    assert again(np.ones(3), 2.5) == 7.5
    assert again(np.ones(3), 3) == 9.0
    assert again.stats.cache_hits.total() == 0
    assert "damaged" in cache.said[0]
    assert kernels.kernel()(total)(np.ones(3), 2.5) == 7.5


def test_without_a_home_kernels_are_not_kept(cache, monkeypatch):
    def nowhere():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", nowhere)
    assert not call()
    assert not call()
    assert len(cache.said) == 1
    assert "no home" in cache.said[0]


def test_who_listens_late_hears_what_there_was(cache):
    troubles, said = disk_cache.Troubles(), []
    troubles.note("unread", "one")
    troubles.note("unread", "two")
    troubles.listen(said.append)
    troubles.note("unwritten", "three")
    assert said == ["one", "three"]


def process(folder, program, **options):
    file = program / "little.py"
    file.write_text(PROGRAM)
    clean = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    return subprocess.Popen(
        [sys.executable, str(file)],
        env=clean
        | {
            "XDG_CACHE_HOME": str(folder),
            "PYTHONPATH": str(ROOT),
            "PYTHONWARNINGS": "ignore",  # joblib's, that there is no room
        },
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        **options,
    )


def lines(started):
    said, _ = started.communicate(timeout=600.0)
    assert started.returncode == 0, said
    told = said.splitlines()
    at = told.index("6 1.5")
    hits = int(told[at + 1])
    del told[at : at + 2]
    return hits, told


def no_room():
    """As on a full disk: not a byte of a file can be written."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))


def test_on_a_full_disk_kernels_are_not_kept(tmp_path):
    hits, troubles = lines(process(tmp_path / "cache", tmp_path, preexec_fn=no_room))
    assert hits == 0
    assert len(troubles) == 1
    assert "File too large" in troubles[0]
    assert "XDG_CACHE_HOME" in troubles[0]
    assert [path for path in (tmp_path / "cache").rglob("*") if path.is_file()] == []


def test_where_the_cache_is_a_file_kernels_are_not_kept(tmp_path):
    (tmp_path / "cache").write_text("mine")
    hits, troubles = lines(process(tmp_path / "cache", tmp_path))
    assert (hits, len(troubles)) == (0, 1)
    assert str(tmp_path / "cache") in troubles[0]
    assert (tmp_path / "cache").read_text() == "mine"


def test_where_nothing_can_be_written_what_is_there_is_used(tmp_path):
    lines(process(tmp_path / "cache", tmp_path))
    assert lines(process(tmp_path / "cache", tmp_path, preexec_fn=no_room)) == (2, [])


def test_processes_that_compile_at_once_do_not_harm_each_other(tmp_path):
    both = [process(tmp_path / "cache", tmp_path) for _ in range(2)]
    assert [lines(each)[1] for each in both] == [[], []]
    hits, troubles = lines(process(tmp_path / "cache", tmp_path))
    assert (hits, troubles) == (2, [])
    assert not list((tmp_path / "cache").rglob("*.tmp"))


CALLING = """
import numba
from placement_planner_ros.core.kernels import kernel

@kernel()
def turned(x):
    a, b, c = x, x + 1, x + 2
    for _ in range(2):
STEPS
    return a + b + c

@kernel()
def caller(x):
    return turned(x)

@numba.njit(cache=True)
def users(x):
    return caller(x)

print(users(3) == turned.py_func(3))
print(caller.inner.stats.cache_hits.total(), turned.inner.stats.cache_hits.total())
""".replace(
    "STEPS", "        a, b, c = a * b % 1009 + c, b * c % 1013 + a, c * a % 1019 + b\n" * 15
)


def test_what_a_kernel_calls_is_there_before_it(tmp_path):
    """Also where a user's own function calls it that numba would keep, and where it is gone."""
    file = tmp_path / "calling.py"
    file.write_text(CALLING)

    def said():
        done = subprocess.run(
            [sys.executable, str(file)],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "c"), "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    assert said() == ["True", "0", "0"]
    assert said() == ["True", "1", "1"]
    (called,) = tmp_path.rglob("turned-*.nbk")
    called.unlink()
    assert said() == ["True", "1", "0"]


def test_a_version_that_another_process_compiles_is_waited_for(cache, monkeypatch):
    call()
    (kept,) = cache.files
    elsewhere = kept.replace(kept.with_suffix(".elsewhere"))
    monkeypatch.setattr(kernel_cache, "_CLAIMED", {})
    with kept.with_suffix(".claim").open("wb") as claim:
        fcntl.flock(claim, fcntl.LOCK_EX)  # as if that process had begun

        def finish():
            elsewhere.replace(kept)
            fcntl.flock(claim, fcntl.LOCK_UN)

        ended = threading.Timer(0.3, finish)
        ended.start()
        assert call()
        ended.join()
    assert kernel_cache._CLAIMED == {}
    assert not kept.with_suffix(".claim").exists()
