"""Results on disk: what is damaged or stale is made anew, what cannot be kept is done without."""

import os
import subprocess
import sys

import joblib
import numpy as np
import pytest

from placement_planner_ros.core import disk_cache
from placement_planner_ros.core.disk_cache import code_digest, digest_of, stored_result

KIND, KEY = "test results", digest_of("a key")


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """The folder of the results; what is said of them is in `cache.said`."""
    monkeypatch.setattr(disk_cache, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(disk_cache, "TROUBLES", disk_cache.Troubles())
    return Cache(tmp_path / "results")


class Cache:
    def __init__(self, folder):
        self.folder = folder
        self.made = 0
        self.said = []
        disk_cache.TROUBLES.listen(self.said.append)

    @property
    def files(self):
        """The first result is of no kind: joblib's note of whose these are."""
        return sorted(self.folder.rglob("output.pkl"), key=os.path.getmtime)[1:]

    def ask(self, key=KEY):
        """What was made or kept; the same numbers either way."""

        def make():
            self.made += 1
            return np.arange(1000.0), "words"

        numbers, words = stored_result(KIND, key, make)
        assert np.array_equal(numbers, np.arange(1000.0))
        assert words == "words"


def test_it_is_made_once_for_each_key(cache):
    for key in (KEY, KEY, "another", "another"):
        cache.ask(key)
    assert cache.made == 2
    assert len(cache.files) == 2
    assert cache.said == []


def one_bit(data):
    whole = bytearray(data)
    whole[len(whole) // 2] ^= 1
    return bytes(whole)


DAMAGES = {
    "nothing": lambda _: b"",
    "garbage": lambda _: b"garbage" * 50,
    "half": lambda data: data[: len(data) // 2],
    "one bit": one_bit,
    "a lost block": lambda data: data[:1024] + bytes(512) + data[1536:],
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_what_is_damaged_is_made_anew_and_that_is_said(cache, damage, caplog):
    cache.ask()
    (file,) = cache.files
    file.write_bytes(DAMAGES[damage](file.read_bytes()))
    cache.ask()
    cache.ask()
    assert cache.made == 2
    (said,) = caplog.messages
    assert KIND in said


def no_folder(cache, _):
    cache.folder.write_text("a file")


def of_another_user(cache, monkeypatch):
    cache.folder.mkdir(parents=True)
    monkeypatch.setattr(os, "geteuid", lambda: cache.folder.stat().st_uid + 1)


@pytest.mark.parametrize("hinder", [no_folder, of_another_user])
def test_where_nothing_can_be_kept_each_is_made_and_that_is_said_once(cache, monkeypatch, hinder):
    hinder(cache, monkeypatch)
    cache.ask()
    cache.ask("another")
    cache.ask()
    assert cache.made == 3
    (words,) = cache.said
    assert str(cache.folder) in words
    assert "XDG_CACHE_HOME" in words


def test_where_the_disk_is_full_each_is_made_and_that_is_said(cache, monkeypatch):
    def dump(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(joblib.numpy_pickle, "dump", dump)
    with pytest.warns(match="Unable to cache to disk.*No space left on device"):
        cache.ask()
    assert cache.made == 1


def test_what_other_code_made_is_not_found(tmp_path, monkeypatch):
    """The code of the module, and of what that imports itself or through others."""
    monkeypatch.setattr(disk_cache, "_PACKAGE", tmp_path / "placement_planner_ros")
    room = tmp_path / "placement_planner_ros" / "core"
    room.mkdir(parents=True)
    (room / "outer.py").write_text("from placement_planner_ros.core.inner import least\n")
    (room / "beside.py").write_text("apart = 1\n")

    def digests():
        code_digest.cache_clear()
        disk_cache._imported_modules.cache_clear()
        names = ("outer", "inner", "beside")
        return [code_digest(f"placement_planner_ros.core.{name}") for name in names]

    (room / "far.py").write_text("least = 1\n")
    (room / "inner.py").write_text("from placement_planner_ros.core.far import least\n")
    before = digests()
    assert digests() == before
    (room / "far.py").write_text("least = 2\n")
    after = digests()
    code_digest.cache_clear()
    disk_cache._imported_modules.cache_clear()
    assert [one == other for one, other in zip(before, after, strict=True)] == [False, False, True]


def test_the_digest_tells_contents_types_and_shapes_apart():
    array = np.arange(6.0)
    parts = [
        (array,),
        (array.astype(np.float32),),
        (array.reshape(2, 3),),
        (array[:5], array[5:]),
        ((array[:5], array[5:]),),
        (array.tobytes(),),
        (b"ab", b"c"),
        (b"a", b"bc"),
        ("ab", "c"),
        (1, 23),
        (12, 3),
    ]
    assert len({digest_of(*each) for each in parts}) == len(parts)
    assert digest_of(array.reshape(3, 2).T) == digest_of(array.reshape(3, 2).T.copy())


WRITER = """
import sys
from pathlib import Path
import numpy as np
from placement_planner_ros.core import disk_cache

disk_cache.cache_folder = lambda: Path(sys.argv[1])
made = np.random.default_rng(0).random((100_000, 3))
print("ready", flush=True)
sys.stdin.readline()
for k in range(40):
    got = disk_cache.stored_result("test results", f"{k // 2}", lambda: made)
    assert np.array_equal(got, made), k
print("done")
"""


def test_processes_that_write_and_read_at_once_do_not_harm_each_other(tmp_path):
    start = [sys.executable, "-W", "ignore", "-c", WRITER, str(tmp_path)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    both = [subprocess.Popen(start, **pipes) for _ in range(2)]
    for each in both:
        assert each.stdout.readline() == "ready\n"
    for each in both:
        each.stdin.write("go\n")
        each.stdin.flush()
    assert [each.communicate(timeout=120.0)[0] for each in both] == ["done\n"] * 2


def test_what_was_used_longest_ago_goes_where_there_is_too_much(cache, monkeypatch):
    cache.ask()
    (file,) = cache.files
    monkeypatch.setattr(disk_cache, "MAX_BYTES", file.stat().st_size - 1)
    disk_cache._opened_results.cache_clear()
    cache.ask("another")
    assert not file.exists()
