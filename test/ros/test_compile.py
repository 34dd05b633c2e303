"""`placement_planner --compile` where it is interrupted or killed, or can keep nothing."""

import os
import select
import signal
import subprocess
import sys

import pytest


def compiling(folder):
    """The program with its kernels in that folder."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder), "PYTHONUNBUFFERED": "1"}
    return subprocess.Popen(
        [sys.executable, "-m", "placement_planner_ros", "placement_planner", "--compile"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        # what a shell starts in the background ignores it, and so does what that starts
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def compilers_of(process):
    """Files that can be read once the processes that compile, which have begun, have ended."""
    while "kernels compiled" not in process.stdout.readline():
        assert process.poll() is None, process.stderr.read()
    with open(f"/proc/{process.pid}/task/{process.pid}/children") as file:
        begun = [int(number) for number in file.read().split()]
    assert len(begun) == len(os.sched_getaffinity(0))
    return [os.pidfd_open(each) for each in begun]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_ended_early_it_leaves_no_process(tmp_path, number):
    process = compiling(tmp_path)
    compilers = compilers_of(process)
    process.send_signal(number)
    _, err = process.communicate(timeout=300.0)
    for each in compilers:
        select.select([each], [], [])
        os.close(each)
    assert list(tmp_path.rglob("all_kept.json")) == [], "they ended because all was compiled"
    if number == signal.SIGINT:
        assert process.returncode == 130
        assert err.startswith("interrupted")
        assert "Traceback" not in err


def test_where_nothing_can_be_kept_it_says_what_to_try(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    _, err = (process := compiling(blocked)).communicate(timeout=300.0)
    assert process.returncode == 1
    assert f"{blocked}/kernels-" in err
    assert "XDG_CACHE_HOME" in err
