"""A signal ends the node, whenever it comes."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from helpers.system import start_node, wait

import placement_planner_ros
from placement_planner_ros.share import share_path

_WITHIN = """
import os, signal
from placement_planner_ros.interrupts import catch_signals
with catch_signals()._cond:  # as the main thread is, at moments, while it waits
    os.kill(os.getpid(), signal.SIGINT)
assert catch_signals().wait(60.0)
"""

LOADING = """
import os, sys

class Interrupt:
    # asked for every module before it is loaded
    def find_spec(self, name, path=None, target=None):
        if name == given[0]:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), int(given[1]))
            print("went on loading")

given, sys.argv[1:] = sys.argv[1:], []
sys.meta_path.insert(0, Interrupt())
from placement_planner_ros import __main__ as programs
getattr(programs, given[2])()
"""


# The node as it is, with inputs; the signal comes as it is about to do what the stage names.
WORKING = """
import contextlib, os, sys, threading, time

stage, number, parameters = sys.argv[1], int(sys.argv[2]), sys.argv[3]
asked = threading.Event()

from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from placement_planner_ros.scenes.yumi import start_configuration
from placement_planner_ros.ros import node as module
from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.inputs.reading import NotReadyError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.ros.run import preparation
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.scenes import scene_by_name

owner, name = {
    "reading": (Robot, "from_urdf"),
    "preparing": (preparation, "make_planner"),
}[stage]
act, make = getattr(owner, name), module.PlacementPlannerNode.__init__

def interrupted(*given):
    if not asked.is_set():
        asked.set()
        os.kill(os.getpid(), number)
    return act(*given)

def made(node, **options):
    make(node, **options)
    threading.Thread(target=use, args=(node,), daemon=True).start()

def use(node):
    values = start_configuration("small_crayons_box")
    joints = JointState(name=list(values), position=list(values.values()))
    points = complete_cloud(scene_by_name("cabinet_high_clutter"))
    cloud = message_from_points(points, Header(frame_id="yumi_body"))
    node._inputs.robot.wait()
    with contextlib.suppress(NotReadyError):  # it ended before the robot was read
        node._inputs.take_cloud("points", cloud, node._settings.current)
    while not asked.is_set():
        node._inputs.take_joint_state(joints)
        node._commands.start()
        time.sleep(0.05)

setattr(owner, name, interrupted)
module.PlacementPlannerNode.__init__ = made
sys.argv[1:] = ["--ros-args", "--params-file", parameters]
module.main()
"""


def run(program, *arguments):
    root = str(Path(placement_planner_ros.__file__).parent.parent)
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
    return subprocess.run(
        [sys.executable, "-c", program, *arguments],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=600.0,
        check=False,
    )


@pytest.mark.parametrize(
    ("program", "module", "number"),
    [("placement_planner", "numba", signal.SIGTERM), ("placement_demo", "numba", signal.SIGINT)],
)
def test_a_signal_that_comes_while_modules_are_loaded_ends_it(program, module, number):
    ended = run(LOADING, module, str(int(number)), program)
    code = 128 + number if program == "placement_demo" else 0
    assert (ended.returncode, ended.stdout, ended.stderr) == (code, "", "")


@pytest.mark.parametrize(
    ("stage", "number"), [("reading", signal.SIGTERM), ("preparing", signal.SIGINT)]
)
def test_a_signal_that_comes_while_the_node_works_ends_it(stage, number):
    ended = run(
        WORKING, stage, str(int(number)), str(share_path("config", "small_crayons_box.yaml"))
    )
    assert ended.returncode == 0, ended.stderr
    assert "Traceback" not in ended.stderr
    assert "Error" not in ended.stderr


def test_no_process_that_compiles_or_reads_outlives_the_node(tmp_path, monkeypatch):
    """A signal comes while kernels are compiled, and a robot of a large mesh is read."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    mesh, urdf = tmp_path / "soup.stl", tmp_path / "robot.urdf"
    corners = np.random.default_rng(0).normal(size=(50_000, 3, 3))  # read and covered for long
    trimesh.Trimesh(**trimesh.triangles.to_kwargs(corners)).export(mesh)
    shape = f'<mesh filename="{mesh.as_uri()}"/>'
    urdf.write_text(
        f'<robot name="r"><link name="l"><collision><geometry>{shape}</geometry></collision></link>'
        "</robot>"
    )
    node = start_node(tmp_path / "node.log", "-p", f"robot_description:={urdf}")

    def others():
        """What was begun with this cache, but for the node."""
        found = []
        for process in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if bytes(tmp_path) in (process / "environ").read_bytes():
                    words = (process / "cmdline").read_bytes().decode()
                    found += [word for word in words.split("\0") if word.startswith("placement_")]
        return sorted(set(found) - {"placement_planner_ros", "placement_planner"})

    try:
        wait(lambda: len(others()) == 2 or node.poll() is not None)
        node.send_signal(signal.SIGINT)
        assert node.wait(120.0) == 0
        wait(lambda: not others(), 20.0)  # less than what they were at takes
    finally:
        node.kill()


def test_a_signal_within_a_wait_does_not_lock():
    subprocess.run([sys.executable, "-c", _WITHIN], timeout=120.0, check=True)
