"""The first start after `warm` is like the second, for a robot that is not bundled, too."""

import subprocess
import sys
from pathlib import Path

import pytest

from placement_planner_ros.ros.inputs.resources import package_share

ROOT = Path(__file__).parents[2]
# In a process of its own, as the other tests call kernels too.
PROGRAM = """
import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from placement_planner_ros.ros.inputs.mesh_process import MeshProcess
from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.node import PlacementPlannerNode
from placement_planner_ros.ros.run import watch
from placement_planner_ros.ros.tools.findings import Findings
from placement_planner_ros.ros.tools.given import read_given, start_in

made = []


def versions():
    # Of all kernels, what was compiled or loaded from disk.
    modules = [m for n, m in sys.modules.items() if n.startswith("placement_planner_ros.core")]
    kernels = {f for module in modules for f in vars(module).values() if hasattr(f, "overloads")}
    return {f"{f.__module__}.{f.__name__}{sign}" for f in kernels for sign in f.overloads}


cover = MeshProcess.cover


def covered(self, vertices, *rest):
    made.append(f"a cover of {len(vertices)} vertices")
    return cover(self, vertices, *rest)


MeshProcess.cover = covered
rclpy.init()
file = Path("config/robots/panda.yaml")
given = read_given(file, {}, Findings())
names = {name: given.parameters[name] for name in given.names if name in given.parameters.specs}
node = PlacementPlannerNode(overrides=[Parameter(n, value=v) for n, v in names.items() if v != []])
node._inputs.robot.wait()
node._inputs.object.wait()
robot = node._inputs.robot.robot
start = dict.fromkeys(robot.joint_names, 0.0) | start_in(file)
node._inputs.take_joint_state(
    JointState(name=list(start), position=[float(value) for value in start.values()])
)
low, high = given.parameters.volume.lower, given.parameters.volume.upper
x, y = np.mgrid[low[0] : high[0] : 0.005, low[1] : high[1] : 0.005].reshape(2, -1)
cloud = np.column_stack([x, y, np.full(len(x), low[2] + 0.03)])
message = message_from_points(cloud, Header(frame_id=robot.root_link))
node._inputs.take_cloud("points", message, node._settings.current)
node.warm_up()
assert node._warm.shown == "true", node._warm.failure
made.clear()
known = versions()
patient = {"joint_state_timeout": 3600.0, "cloud.max_age": 0.0}
answer = node._commands.start([Parameter(name, value=value) for name, value in patient.items()])
assert answer.success, answer.text
run = node._commands.run
while run.active and not run.solutions:
    time.sleep(0.05)
print("placed" if run.solutions else run.summary())
node._commands.stop()
watch.way_of(run.snapshot, run.planner.environment, run.best)
print(*made, *sorted(versions() - known), sep="; ")
node.close()
rclpy.shutdown()
"""


def test_after_warm_no_other_version_of_a_kernel_is_needed_and_nothing_covered():
    try:
        package_share("example-robot-data")
    except FileNotFoundError:
        pytest.skip("example-robot-data is missing: pip install '.[robots]'")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-2:] == ["placed", ""], done.stdout
