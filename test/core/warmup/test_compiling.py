"""Compiling in processes of their own: what is missing, no more, and told."""

import os
import shutil
import signal
import subprocess
import sys
import time
import types
from pathlib import Path

import pytest

from placement_planner_ros.core.kernels import kernel_folder, kernel_names
from placement_planner_ros.core.stopping import StoppedError, stoppable
from placement_planner_ros.core.warmup import compiling
from placement_planner_ros.core.warmup.compiling import CompilationError, compile_kernels

A_KERNEL = "_raise_to_slope"
"""Called from Python: what kernels call is compiled with them alone."""


@pytest.fixture(scope="module")
def all_kept():
    """The kernels' folder, with all of them in it."""
    compile_kernels(lambda *_: None)
    return kernel_folder()


@pytest.fixture
def without_one(all_kept, tmp_path, monkeypatch):
    """A folder of its own in which one kernel is missing."""
    here = tmp_path / all_kept.name
    shutil.copytree(all_kept, here)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(here))
    for path in [*here.glob(f"*/*.{A_KERNEL}-*.nbi"), here / "all_kept.json"]:
        path.unlink()
    return here


def missing_in(folder):
    return kernel_names() - {path.name.partition("-")[0] for path in folder.glob("*/*.nbi")}


def test_the_known_task_calls_every_kernel(all_kept):
    assert missing_in(all_kept) == set()


def test_what_is_missing_is_compiled_and_told(without_one):
    told = []
    inlined = next(without_one.glob("*/*.nbi"))  # as a test that calls one leaves it
    shutil.copy(inlined, inlined.with_name("inlined.only_written_into_others-1.py311.nbi"))
    assert missing_in(without_one) == {f"clearance.{A_KERNEL}"}
    compile_kernels(lambda *each: told.append(each))
    assert missing_in(without_one) == set()
    assert told[-1] == (len(kernel_names()),) * 2


def test_no_kernel_is_compiled_by_two_processes_at_once(tmp_path):
    one, other = (compiling._Turns(tmp_path) for _ in range(2))
    compiled = types.SimpleNamespace(
        data={"dispatcher": types.SimpleNamespace(py_func=kernel_folder)}
    )
    one.on_start(compiled)
    with pytest.raises(compiling._Elsewhere):
        other.on_start(compiled)
    other.on_end(compiled)
    one.on_end(compiled)
    with pytest.raises(compiling._Elsewhere):
        other.on_start(compiled)  # it is not written yet
    other.on_end(compiled)
    one.give_back()
    other.on_start(compiled)


def test_it_can_be_stopped(without_one, monkeypatch):
    begun = []
    spawn = compiling._spawn_process
    monkeypatch.setattr(
        compiling, "_spawn_process", lambda *given: begun.append(spawn(*given)) or begun[-1]
    )
    with stoppable(lambda: True), pytest.raises(StoppedError):
        compile_kernels(lambda *_: None)
    assert len(begun) == len(os.sched_getaffinity(0))
    assert 0 not in [process.wait(30.0) for process in begun]


CALLER = """
from placement_planner_ros.core.warmup import compiling

spawn = compiling._spawn_process


def spawned(*given):
    process = spawn(*given)
    print(process.pid, flush=True)
    return process


compiling._spawn_process = spawned
compiling.compile_kernels(lambda *_: None)
"""


def test_they_end_with_the_process_that_began_them(without_one):
    caller = subprocess.Popen([sys.executable, "-c", CALLER], stdout=subprocess.PIPE, text=True)
    pids = [int(caller.stdout.readline()) for _ in os.sched_getaffinity(0)]
    caller.send_signal(signal.SIGKILL)
    caller.wait()
    caller.stdout.close()
    for pid in pids:
        while is_running(pid):
            time.sleep(0.05)
    assert missing_in(without_one)


def is_running(pid):
    try:
        return ") Z " not in Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return False


def test_a_folder_that_cannot_be_written_is_told_at_once(monkeypatch, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(blocked))
    monkeypatch.setattr(compiling, "_spawn_process", None)
    with pytest.raises(CompilationError, match=r"file/kernels-\w+: Not a directory"):
        compile_kernels(lambda *_: None)


def test_processes_that_fail_are_told(without_one, monkeypatch):
    monkeypatch.setattr(compiling.sys, "executable", "/bin/false")
    with pytest.raises(CompilationError, match="ended by 1"):
        compile_kernels(lambda *_: None)
