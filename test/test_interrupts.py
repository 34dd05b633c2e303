"""Signals that end a program."""

import subprocess
import sys

_WITHIN = """
import os, signal
from placement_planner_ros.interrupts import catch_signals
with catch_signals()._cond:  # as the main thread is, at moments, while it waits
    os.kill(os.getpid(), signal.SIGINT)
assert catch_signals().wait(60.0)
"""


def test_a_signal_within_a_wait_does_not_lock():
    subprocess.run([sys.executable, "-c", _WITHIN], timeout=120.0, check=True)
