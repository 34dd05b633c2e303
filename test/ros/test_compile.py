"""`placement_planner --compile` where it is interrupted, or can keep nothing."""

import os
import signal
import subprocess
import sys

import pytest


def compiling(folder):
    """The program with its kernels in that folder."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder), "PYTHONUNBUFFERED": "1"}
    environment.pop("NUMBA_CACHE_DIR", None)
    return subprocess.Popen(
        [sys.executable, "-m", "placement_planner_ros", "placement_planner", "--compile"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        # what a shell starts in the background ignores it, and so does what that starts
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def compilers(process):
    """Processes that it has started."""
    with open(f"/proc/{process.pid}/task/{process.pid}/children") as file:
        return [int(number) for number in file.read().split()]


def test_interrupted_it_says_so_and_leaves_no_process(tmp_path):
    process = compiling(tmp_path)
    while "kernels compiled" not in process.stdout.readline():
        assert process.poll() is None, process.stderr.read()
    begun = compilers(process)
    assert begun
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=300.0)
    assert process.returncode == 130
    assert err.startswith("interrupted")
    assert "Traceback" not in err
    for each in begun:
        with pytest.raises(ProcessLookupError):
            os.killpg(each, 0)


def test_where_nothing_can_be_kept_it_says_what_to_try(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    _, err = (process := compiling(blocked)).communicate(timeout=300.0)
    assert process.returncode == 1
    assert f"{blocked}/placement_planner_ros: Not a directory" in err
    assert "XDG_CACHE_HOME" in err
