"""A planner that does what a test tells it to, and a client of the node."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from helpers.home import HOME
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Float64, Header
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from placement_planner_ros.core.explanation.explanation import Explanation
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import Goal, Placement, Trajectory
from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.node import PlacementPlannerNode
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.ros.spinning import PooledExecutor, spin_until
from placement_planner_ros.scenes.objects import object_by_name

FRAME = "yumi_body"
COMPILED = 1800.0
"""Seconds within which all kernels are compiled, on a busy machine."""
TABLE = np.array(
    [[x, y, 0.0] for x in np.arange(0.2, 0.6, 0.005) for y in np.arange(-0.3, 0.3, 0.005)]
)


class FakeStatistics:
    def __init__(self):
        self.samples = 0
        self.rejected = {"unstable": 0}
        self.solutions, self.gap = 0, None


def placement(objective, arm="left", retreats=False, x=0.4, terms=()):
    """A placement whose motion is short and whose numbers are easy to recognise."""
    joints = tuple(f"yumi_joint_{n}_{arm[0]}" for n in (1, 2, 7, 3, 4, 5, 6))
    start = np.array([HOME[j] for j in joints])
    positions = np.array([start, start + 0.05])
    zeros = np.zeros_like(positions)
    trajectory = Trajectory(joints, np.array([0.0, 1.0]), positions, zeros, zeros)
    T = pin.SE3(np.eye(3), np.array([x, 0.0, 0.1]))
    goal = Goal(arm, 0, 1, T, 0.0, positions, objective)
    retreat = Trajectory(joints, np.array([0.0, 1.0]), positions[::-1], zeros, zeros)
    return Placement(goal, trajectory, 0.5, 0.25, 10, retreat if retreats else None, terms)


class FakePlanner:
    """Yields what is put into `offers`; ends when told to stop or when `done` is set."""

    def __init__(self, told, environment):
        self.environment = environment
        self.statistics = FakeStatistics()
        self.exhausted = ""
        self.explanation, self.told = Explanation(""), told
        self.cause = None
        self.unusable = ()
        self.offers = []
        self.error = None
        self.deaf = False
        self.retreats = False
        self.done = threading.Event()
        self.searching = threading.Event()

    def explain(self):
        self.explanation = self.told
        return self.explanation

    def run(self, should_stop):
        self.searching.set()
        while not self.done.is_set() and (self.deaf or not should_stop()):
            self.statistics.samples += 1
            if self.error is not None:
                raise self.error
            if self.offers:
                offer = self.offers.pop(0)
                made = isinstance(offer, Placement)
                yield offer if made else placement(offer, retreats=self.retreats)
            time.sleep(0.002)


class Spinning:
    """Spins an executor in a thread; shut down only once that thread has ended."""

    def __init__(self, executor):
        self._executor = executor
        self._asked = threading.Event()
        self._thread = threading.Thread(target=spin_until, args=(executor, self._asked))
        self._thread.start()

    def end(self):
        self._asked.set()
        self._thread.join()
        pooled = isinstance(self._executor, PooledExecutor)
        ended = not pooled or self._executor.finish(COMPILED)
        self._executor.shutdown()
        assert ended, "a callback hangs"


class Bench:
    """A node with a fake planner, a client that records all it hears, and its sensors."""

    def __init__(self, *, warm=True, first_run=1, **parameters):
        held = object_by_name("small_crayons_box")
        values = {
            "object.vertices": held.vertices.ravel().tolist(),
            "object.triangles": held.triangles.ravel().tolist(),
            "target_volume": [0.2, -0.3, -0.1, 0.6, 0.3, 0.2],
            "joint_state_timeout": 3600.0,  # however slow the machine is
            "cloud.max_age": 0.0,
            **{
                f"{arm}.grasps": [v for g in grasps for v in pin.SE3ToXYZQUAT(g)]
                for arm, grasps in held.grasps.items()
            },
            **parameters,
        }
        self.planners = []
        self.snapshots = []
        self.explanation = Explanation("nothing was tried")
        self.preparing = lambda should_stop: None
        self.node = PlacementPlannerNode(
            self._prepare, [Parameter(n, value=v) for n, v in values.items() if v is not None]
        )
        if first_run is not None:  # runs 1, 2, … are easier to tell apart
            self.node._commands._number = first_run - 1
        if warm:
            self.node._warm.set()
        self.client = Node("client")
        self.heard = []
        for topic, kind in {
            "trajectory": JointTrajectory,
            "retreat_trajectory": JointTrajectory,
            "placement_pose": PoseStamped,
            "objective": Float64,
            "markers": MarkerArray,
            "solution": DiagnosticArray,
            "status": DiagnosticStatus,
            "occupancy": PointCloud2,
        }.items():
            self.client.create_subscription(
                kind,
                f"placement_planner/{topic}",
                lambda message, topic=topic: self.heard.append((topic, message)),
                LATCHED,
            )
        self.client.create_subscription(
            DiagnosticArray, "/diagnostics", lambda m: self.heard.append(("diagnostics", m)), 10
        )
        self._joints = self.client.create_publisher(JointState, "joint_states", 10)
        self._clouds = self.client.create_publisher(PointCloud2, "points", 1)
        self._services = {}
        self.executor = PooledExecutor(8, self.node.calls)
        self.executor.add_node(self.node)
        self.executor.add_node(self.client)
        self._spinning = Spinning(self.executor)

    def close(self):
        for planner in self.planners:
            planner.done.set()
        self.node.close()
        self._spinning.end()
        self.node.destroy_node()
        self.client.destroy_node()

    def _prepare(self, snapshot, should_stop):
        self.preparing(should_stop)
        self.snapshots.append(snapshot)
        points = np.vstack(snapshot.clouds)
        around = points.min(axis=0) - 0.3, points.max(axis=0) + 0.3
        volume = snapshot.parameters.volume
        environment = Environment.from_points(points, volume, bounds=around)
        self.planners.append(FakePlanner(self.explanation, environment))
        return self.planners[-1]

    # --- the world around the node

    def joint_state(self, **changes):
        values = {**HOME, **changes}
        self._joints.publish(
            JointState(name=list(values), position=[float(v) for v in values.values()])
        )

    def cloud(self, points=TABLE, frame=FRAME, stamp=None):
        message = message_from_points(np.asarray(points), Header(frame_id=frame))
        if stamp is not None:
            message.header.stamp = stamp
        self._clouds.publish(message)

    def feed(self):
        """Publish inputs until the node has them."""
        clouds = self.node._inputs.clouds
        before = clouds.updates
        self.wait(lambda: clouds.updates > before, again=self.cloud)
        began = time.monotonic()
        self.wait(lambda: self._joints_came_since(began), again=self.joint_state)

    def _joints_came_since(self, began):
        now = time.monotonic()
        return self.node._inputs.joints.age(now) < now - began

    def wait(self, condition, timeout=600.0, again=None):
        """Wait until a condition holds, doing something again and again."""
        end = time.monotonic() + timeout
        last = 0.0
        while not condition():
            assert time.monotonic() < end, "waited in vain"
            if again is not None and time.monotonic() - last > 0.2:
                last = time.monotonic()
                again()
            time.sleep(0.005)

    # --- what a client does

    def call(self, name, **parameters):
        """Call a service; `..._with` services take parameters."""
        with_parameters = name.endswith("_with") or name == "remove_placed"
        kind = SetParametersAtomically if with_parameters else Trigger
        if name not in self._services:
            self._services[name] = self.client.create_client(kind, f"placement_planner/{name}")
        client = self._services[name]
        assert client.wait_for_service(120.0)
        request = kind.Request()
        if with_parameters:
            request.parameters = [
                ParameterMessage(name=n, value=ParameterValue(type=v.type))
                if isinstance(v, SimpleNamespace)
                else Parameter(n.replace("__", "."), value=v).to_parameter_msg()
                for n, v in parameters.items()
            ]
        future = client.call_async(request)
        self.wait(future.done)
        response = future.result()
        if with_parameters:
            return said(response.result.successful, response.result.reason)
        return said(response.success, response.message)

    def messages(self, topic):
        return [message for name, message in list(self.heard) if name == topic]

    def manifests(self):
        return [values_of(m.status[0]) for m in self.messages("solution")]

    def status(self):
        self.wait(lambda: self.messages("status"))
        return values_of(self.messages("status")[-1])


def started(bench, **parameters):
    """Inputs given, run started, planner searching; again where they are read, or old, by then."""
    code, count = None, len(bench.planners)
    while code in (None, "NOT_READY", "CLOUD_STALE", "JOINTS_STALE"):
        bench.feed()
        answer = bench.call("start_with" if parameters else "start", **parameters)
        code = answer.code
    assert answer.success, answer.text
    bench.wait(lambda: len(bench.planners) > count)
    bench.wait(bench.planners[-1].searching.is_set)
    return bench.planners[-1]


def ended(bench, run, state):
    """The status of a run once it is in that state."""
    bench.wait(lambda: (bench.status()["run"], bench.status()["state"]) == (str(run), state))
    return bench.status()


def said(success, text):
    """An answer taken apart."""
    first, _, words = text.partition("\n")
    values = dict(pair.split("=") for pair in first.split())
    return SimpleNamespace(success=success, text=text, words=words, **{"run": None, **values})


def values_of(status):
    return {v.key: v.value for v in status.values}
