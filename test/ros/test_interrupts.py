"""A signal ends the node, whenever it comes."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import placement_planner_ros

PROGRAM = """
import os, sys

class Interrupt:
    # asked for every module before it is loaded
    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[1]:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), int(sys.argv[2]))

sys.meta_path.insert(0, Interrupt())
from placement_planner_ros.__main__ import placement_planner
sys.argv = ["placement_planner"] + sys.argv[1:]
placement_planner()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("module", ["placement_planner_ros.ros.node", "numba", "rclpy.node"])
def test_a_signal_that_comes_while_modules_are_loaded_ends_the_node(module, number):
    root = str(Path(placement_planner_ros.__file__).parent.parent)
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
    ended = subprocess.run(
        [sys.executable, "-c", PROGRAM, module, str(int(number))],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=120.0,
        check=False,
    )
    assert (ended.returncode, ended.stderr) == (0, "")
