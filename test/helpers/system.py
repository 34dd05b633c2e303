"""The real node as a process of its own, and a client as a user would write it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from helpers.fakes import Spinning, said, values_of
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

import placement_planner_ros
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.share import share_path

SCENE, OBJECT = "cabinet_high_clutter", "small_crayons_box"
NODE = "placement_planner"
PARTS = {
    "trajectory": JointTrajectory,
    "retreat_trajectory": JointTrajectory,
    "placement_pose": PoseStamped,
    "objective": Float64,
    "markers": MarkerArray,
    "occupancy": PointCloud2,
    "solution": DiagnosticArray,
    "status": DiagnosticStatus,
}


EVERY = QoSProfile(depth=100, reliability=LATCHED.reliability, durability=LATCHED.durability)
"""What is latched, and all that comes in between, as far as it is sent."""


def start_node(log: Path, *arguments: str) -> subprocess.Popen:
    """The node under test: of the package that these tests import."""
    root = str(Path(placement_planner_ros.__file__).parent.parent)
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
    with log.open("wb") as stream:
        return subprocess.Popen(
            [sys.executable, "-m", "placement_planner_ros", NODE, "--ros-args", *arguments],
            cwd=log.parent,
            env={**os.environ, "PYTHONPATH": path},
            stdout=stream,
            stderr=subprocess.STDOUT,
        )


def running_node(log: Path):
    """The node with the usual object, until it is gone on with; then what it has said."""
    process = start_node(log, "--params-file", str(share_path("config", f"{OBJECT}.yaml")))
    yield process
    process.send_signal(signal.SIGINT)
    try:
        process.wait(60.0)
    except subprocess.TimeoutExpired:
        process.kill()
    print(log.read_text())


class Client(Node):
    """Keeps what it hears; calls services by name."""

    def __init__(self, name):
        super().__init__(name)
        self.heard = {topic: [] for topic in PARTS}
        for topic, kind in PARTS.items():
            self.create_subscription(kind, f"{NODE}/{topic}", self.heard[topic].append, EVERY)
        self._asked_of = {}
        self.executor_ = SingleThreadedExecutor()
        self.executor_.add_node(self)
        self._spinning = Spinning(self.executor_)
        self.guests = []
        """Nodes that it spins, too, destroyed once none of their callbacks can run."""

    def close(self):
        self._spinning.end()
        for node in (*self.guests, self):
            node.destroy_node()

    def request(self, kind, service, request, node=NODE):
        name = f"{node}/{service}"
        if name not in self._asked_of:
            self._asked_of[name] = self.create_client(kind, name)
        assert self._asked_of[name].wait_for_service(120.0)
        future = self._asked_of[name].call_async(request)
        wait(future.done)
        return future.result()

    def call(self, service, **parameters):
        if not (service.endswith("_with") or service == "remove_placed"):
            response = self.request(Trigger, service, Trigger.Request())
            return said(response.success, response.message)
        request = SetParametersAtomically.Request(
            parameters=[
                Parameter(n.replace("__", "."), value=v).to_parameter_msg()
                for n, v in parameters.items()
            ]
        )
        result = self.request(SetParametersAtomically, service, request).result
        return said(result.successful, result.reason)

    def solutions(self, run):
        """Manifests of that run's solutions, without the one that clears."""
        manifests = [values_of(m.status[0]) for m in list(self.heard["solution"])]
        return [m for m in manifests if m["run"] == run and m["solution"] != "0"]

    def last_solution(self, run):
        """Number of the newest; of two in quick succession a latched topic may keep only one."""
        return int(self.solutions(run)[-1]["solution"]) if self.solutions(run) else 0

    def value(self, key):
        """A value of the newest status."""
        return values_of(self.heard["status"][-1])[key] if self.heard["status"] else None

    def state(self):
        return self.value("state")


def wait(condition, timeout=600.0):
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def start_when_ready(client, service="start", **parameters):
    """Start as soon as the first inputs have arrived."""
    answers = []

    def accepted():
        answers.append(client.call(service, **parameters))
        return answers[-1].success

    wait(accepted)
    return answers[-1]
