"""Compiling in processes of their own: what is missing, no more, and told."""

import os
import shutil
import subprocess
import sys
import time
from contextlib import suppress

import pytest
from numba.core import config

from placement_planner_ros.core.disk_cache import cache_folder
from placement_planner_ros.core.kernels import not_kept
from placement_planner_ros.core.stopping import StoppedError, stoppable
from placement_planner_ros.core.warmup import compiling
from placement_planner_ros.core.warmup.compiling import (
    CompilationError,
    CompilationProgress,
    compile_kernels,
)
from placement_planner_ros.core.warmup.warm_up import load_kernels

A_KERNEL = "check_states"


@pytest.fixture(scope="module")
def all_kept():
    """The kernels' folder, with all of them in it."""
    load_kernels()
    compile_kernels(lambda _: None)
    return cache_folder()


@pytest.fixture
def without_one(all_kept, tmp_path, monkeypatch):
    """A folder of its own in which one kernel is missing; its name."""
    shutil.copytree(all_kept, tmp_path / "placement_planner_ros")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(config, "CACHE_DIR", "")
    here = tmp_path / "placement_planner_ros"
    for _, cache in compiling_caches():
        monkeypatch.setattr(cache, "_folder", str(here / cache.cache_path.rsplit("/", 1)[-1]))
    for path in [*here.glob(f"*/{A_KERNEL}-*.nbk"), *here.glob("passed-*")]:
        path.unlink()
    return A_KERNEL


def compiling_caches():
    from placement_planner_ros.core import kernels

    return kernels._KERNELS


def test_the_known_task_calls_every_kernel(all_kept):
    assert not_kept()[0] == []


def test_what_is_missing_is_compiled_and_told(without_one):
    missing, kernels = not_kept()
    assert [name.split("-")[0] for name in missing] == [without_one]
    told = []
    compile_kernels(told.append)
    assert not_kept() == ([], kernels)
    assert (told[0].done, told[-1].done) == (kernels - 1, kernels)


def test_nothing_is_begun_where_nothing_is_missing(all_kept, monkeypatch):
    monkeypatch.setattr(compiling, "_spawn_process", None)
    compile_kernels(lambda _: None)


UNLOADABLE = """
from placement_planner_ros.core.disk_cache import TROUBLES
from placement_planner_ros.core.warmup import compiling

TROUBLES.listen(print)
compiling._run_processes = lambda errors, look: look()  # compiles nothing
compiling.compile_kernels(print)
"""


@pytest.mark.parametrize("cut", ["*/*.nbk", f"*/{A_KERNEL}-*.nbk", "passed-*"])
def test_a_cache_that_cannot_be_loaded_is_emptied_and_that_is_said(all_kept, tmp_path, cut):
    """In a process of its own, as this one has loaded all."""
    here = shutil.copytree(all_kept, tmp_path / "placement_planner_ros")
    for path in here.glob(cut):
        os.truncate(path, path.stat().st_size // 2)
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", UNLOADABLE],
        env=environment | {"XDG_CACHE_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    said, begun, _ = done.stdout.splitlines()
    assert f"{here} cannot be loaded" in said
    assert begun.startswith("0 of ")


def test_it_can_be_stopped(without_one, monkeypatch):
    begun = []
    spawn = compiling._spawn_process
    monkeypatch.setattr(
        compiling, "_spawn_process", lambda *given: begun.append(spawn(*given)) or begun[-1]
    )
    with stoppable(lambda: True), pytest.raises(StoppedError):
        compile_kernels(lambda _: None)
    assert [process.wait(30.0) != 0 for process in begun] == [True]
    with suppress(ProcessLookupError):
        while True:
            os.killpg(begun[0].pid, 0)
            time.sleep(0.05)
    assert len(not_kept()[0]) == 1, "the other process went on"


def test_a_folder_that_cannot_be_written_is_told_at_once(without_one, monkeypatch, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    monkeypatch.setattr(compiling, "_spawn_process", None)
    with pytest.raises(CompilationError, match=r"file/placement_planner_ros: Not a directory"):
        compile_kernels(lambda _: None)


def test_processes_that_fail_are_told(without_one, monkeypatch):
    monkeypatch.setattr(compiling.sys, "executable", "/bin/false")
    with pytest.raises(CompilationError, match="ended by 1"):
        compile_kernels(lambda _: None)


def test_progress_in_words():
    assert str(CompilationProgress(4, 100, 3.0)) == "4 of 100 kernels compiled"
    assert (
        str(CompilationProgress(60, 100, 30.0, 20)) == "60 of 100 kernels compiled, some 30 s left"
    )
