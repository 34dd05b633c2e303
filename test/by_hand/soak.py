"""Uses the real node for as long as wanted, as clients, sensors and others do who err, and judges.

    python test/by_hand soak --minutes 60

Several clients call every service at random; clouds and joint states come and fail, objects and
robots are good and bad. Clouds and parameters without sense are `test_any_input`'s. What is good is
always the same world, so that whatever is published can be checked. Every line of the report that
is not as it should be is named at its end, and then the exit code is 1.
"""

import argparse
import functools
import json
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pinocchio as pin
import psutil
import rclpy
from geometry_msgs.msg import Point
from helpers.domains import claimed_domain
from helpers.fakes import Spinning, said
from helpers.published import pose_of, solution_of, task_of
from helpers.system import NODE, OBJECT, SCENE, start_node, wait
from helpers.tasks import yumi_checker
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState, PointCloud2
from shape_msgs.msg import Mesh, MeshTriangle
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

from placement_planner_ros.client.subscriptions import Subscriptions
from placement_planner_ros.client.waiting import News
from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import start_configuration
from placement_planner_ros.share import share_path

FRAME = "yumi_body"
PATIENCE = 30.0
"""Seconds after which a call counts as never answered."""
TICK = 0.05
"""Seconds between joint states."""
LEAST_CALLS = 5_000
"""In an hour."""
STANDING = 2
"""Objects that may stand at a time, so that there is room for more."""
MEMORY_SETTLED = 600.0
"""Seconds from which on memory may not grow, in a soak of twice that and more."""
GROWTH, SHORT_GROWTH = 0.02, 0.3
"""Of memory from then on; and of shorter soaks, from a third of their time on, in which the first
runs still fill caches."""
SHORT_MORE = 3
"""Threads or descriptors that a shorter soak may end with beyond those it had, as a run may go on
over all of the time that is looked at."""

# --- what is published to the node


def parameter(name, value):
    return Parameter(name, value=value).to_parameter_msg()


def box_mesh(vertices, triangles):
    return Mesh(
        vertices=[Point(x=float(x), y=float(y), z=float(z)) for x, y, z in vertices],
        triangles=[MeshTriangle(vertex_indices=[int(i) for i in t]) for t in triangles],
    )


def bad_objects(held):
    vertices, triangles = held.vertices, held.triangles
    return [
        Mesh(),
        box_mesh(vertices, triangles + len(vertices)),
        box_mesh(vertices * np.nan, triangles),
        box_mesh(vertices * 1e30, triangles),
    ]


def bad_robots(urdf):
    return [
        "<robot/>",
        urdf[: len(urdf) // 2],
        urdf.replace(".stl", ".gone"),
        "<robot name='r'>" + "".join(f"<link name='l{i}'/>" for i in range(3000)) + "</robot>",
    ]


class World(Node):
    """Sensors, and whoever tells of the object and the robot: mostly right."""

    MOODS = ("good",) * 6 + ("moving", "object", "robot", "silent")

    def __init__(self, rng):
        super().__init__("world")
        self._rng = rng
        self._held = object_by_name(OBJECT)
        self._urdf = share_path("urdf", "yumi.urdf").read_text()
        self._srdf = share_path("urdf", "yumi.srdf").read_text()
        self._values = start_configuration(OBJECT)
        points = complete_cloud(scene_by_name(SCENE))
        self._cloud = message_from_points(points, Header(frame_id=FRAME))
        self._bad = {"object": bad_objects(self._held), "robot": bad_robots(self._urdf)}
        self._clouds = self.create_publisher(PointCloud2, "points", 1)
        self._joints = self.create_publisher(JointState, "joint_states", 10)
        self._object = self.create_publisher(Mesh, f"{NODE}/object", LATCHED)
        self._robot = self.create_publisher(String, "robot_description", LATCHED)
        self._semantic = self.create_publisher(String, "robot_description_semantic", LATCHED)
        self._ticks = 0
        self._until = time.monotonic() + 20.0
        self._mood = "good"
        self.create_timer(TICK, self._tick)

    def _tick(self):
        self._ticks += 1
        if time.monotonic() > self._until:
            self._mend()
            self._mood = self._any(self.MOODS)
            self._until = time.monotonic() + self._rng.uniform(3.0, 15.0)
        mood = self._mood
        if mood == "silent":
            return
        if mood == "moving":  # never at rest, so that no run begins elsewhere
            self._tell_joints(0.1 * (self._ticks % 2), 0.5)
        else:
            self._tell_joints()
        if self._ticks % 20 == 0:
            self._cloud.header.stamp = self.get_clock().now().to_msg()
            self._clouds.publish(self._cloud)
        if mood == "object" and self._ticks % 10 == 0:
            self._object.publish(self._any(self._bad["object"]))
        if mood == "robot" and self._ticks % 40 == 0:
            self._robot.publish(String(data=self._any(self._bad["robot"])))

    def _mend(self):
        """What comes once is told anew, as it should be."""
        if self._mood == "object":
            self._object.publish(box_mesh(self._held.vertices, self._held.triangles))
        if self._mood == "robot":
            self._robot.publish(String(data=f"{self._urdf}<!-- {self._ticks} -->"))
            self._semantic.publish(String(data=f"{self._srdf}<!-- {self._ticks} -->"))

    def _any(self, among):
        return among[self._rng.integers(len(among))]

    def _tell_joints(self, offset=0.0, velocity=0.0):
        message = JointState(
            name=list(self._values),
            position=[value + offset for value in self._values.values()],
            velocity=[velocity] * len(self._values),
        )
        message.header.stamp = self.get_clock().now().to_msg()
        self._joints.publish(message)


# --- what is asked of the node

SENSIBLE = [
    lambda rng: ("objective", ["maximize_clearance", "minimize_clearance"][rng.integers(2)]),
    lambda rng: ("arms", [["left"], ["right"], ["left", "right"]][rng.integers(3)]),
    lambda rng: ("time_limit", float(rng.uniform(1.0, 20.0))),
    lambda rng: ("seed", int(rng.integers(1000))),
    lambda rng: ("sampler", ["optimistic", "mcts", "uniform"][rng.integers(3)]),
    lambda rng: ("local_optimization", bool(rng.integers(2))),
    lambda rng: ("velocity_scaling", float(rng.uniform(0.2, 1.0))),
]
STORED = SENSIBLE[2:]
"""Those that a client may set for all: what a run is checked against does not change."""


class Caller(Node):
    """A client that calls anything at any time; one call after the other."""

    def __init__(self, number, watcher, rng):
        super().__init__(f"caller_{number}")
        self._watcher = watcher
        self._rng = rng
        self._asked_of = {}
        self.asked = threading.Event()
        self.calls = 0
        self.unanswered = []
        self._thread = threading.Thread(target=self._work, daemon=True)

    def start(self):
        self._thread.start()

    def end(self):
        self.asked.set()
        self._thread.join(2 * PATIENCE)

    def _work(self):
        names, weights = zip(*WEIGHTS.items(), strict=True)
        weights = np.array(weights) / sum(weights)
        while not self.asked.wait(self._rng.exponential(0.3)):
            getattr(self, f"_{self._rng.choice(names, p=weights)}")()

    def _ask(self, kind, service, request):
        """The answer, None where none came."""
        if service not in self._asked_of:
            self._asked_of[service] = self.create_client(kind, f"{NODE}/{service}")
            self._asked_of[service].wait_for_service(PATIENCE)
        client, done = self._asked_of[service], threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _: done.set())
        self.calls += 1
        if not done.wait(PATIENCE):
            client.remove_pending_request(future)
            self.unanswered.append(service)
            return None
        return future.result()

    def _trigger(self, service):
        response = self._ask(Trigger, service, Trigger.Request())
        return response and said(response.success, response.message)

    def _with(self, service, parameters):
        request = SetParametersAtomically.Request(parameters=parameters)
        response = self._ask(SetParametersAtomically, service, request)
        return response and said(response.result.successful, response.result.reason)

    def _some(self, among, most=3):
        return [among[i] for i in self._rng.integers(len(among), size=self._rng.integers(1, most))]

    def _sensible(self, among):
        return dict(make(self._rng) for make in self._some(among))

    # what is done in turn with those that change what stands or what runs: its order is known

    def _start_with(self):
        with self._watcher.order:
            values = self._sensible(SENSIBLE)
            made = [parameter(name, value) for name, value in values.items()]
            answer = self._with("start_with", made)
            if answer is not None and answer.success:
                self._watcher.begun(answer.run, values.get("objective", "maximize_clearance"))

    def _confirm(self):
        with self._watcher.order:
            run, count = self._watcher.last, len(self._watcher.standing)
            if count >= STANDING or run is None:
                return
            solution = self._watcher.any_solution(run, self._rng)
            if solution is None:
                return
            made = [parameter("run", int(run)), parameter("solution", int(solution))]
            answer = self._with("confirm_placed_with", made)
            if answer is not None and answer.success:
                self._watcher.stands(run, solution)

    def _confirm_badly(self):
        with self._watcher.order:
            wrong = [parameter("run", 7), parameter("solution", 1)]
            self._with("confirm_placed_with", wrong[: self._rng.integers(3)])

    def _remove(self):
        with self._watcher.order:
            run = next(iter(self._watcher.standing), "7")
            answer = self._with("remove_placed", [parameter("run", int(run))])
            if answer is not None and answer.success:
                self._watcher.standing.pop(run, None)

    def _clear(self):
        with self._watcher.order:
            answer = self._trigger("clear_environment")
            if answer is not None and answer.success:
                self._watcher.standing.clear()

    # what anybody does at any moment

    def _stop(self):
        self._trigger("stop")

    def _stop_with(self):
        run = self._watcher.last
        number = 7 if run is None or self._rng.random() < 0.5 else int(run)
        self._with("stop_with", [parameter("run", number)][: self._rng.integers(2) + 1])

    def _set(self):
        made = [parameter(n, v) for n, v in self._sensible(STORED).items()]
        self._ask(SetParameters, "set_parameters", SetParameters.Request(parameters=made))


WEIGHTS = {
    "start_with": 20,
    "confirm": 3,
    "confirm_badly": 3,
    "remove": 3,
    "clear": 2,
    "stop": 1,
    "stop_with": 3,
    "set": 8,
}
"""How often each is done; runs must go on for a few seconds now and then."""


# --- what the node publishes


@functools.lru_cache(maxsize=4)
def checker_of(objective, placed):
    poses = [pin.SE3(np.frombuffer(pose).reshape(4, 4)) for pose in placed]
    return yumi_checker(task_of(SCENE, OBJECT, objective, poses))


def check(objective, placed, solution):
    """What is wrong with a solution; in a process of its own."""
    return checker_of(objective, placed).check(solution)


def be_quiet():
    os.nice(2)
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class Watcher(Node):
    """Has all solutions checked that a client hears.

    Attributes:
        order: held by whoever changes what runs or what stands.
        last: the newest run.
        nodes: of the name that is called, at most at a time.
        standing: poses of what stands, by run.
        poses: of solutions heard, by run and number.
        checks: of these, by their key.
        faults: in words, what contradicts something else.
    """

    def __init__(self):
        super().__init__("watcher")
        self.order = threading.Lock()
        self.last, self.nodes = None, 0
        self.standing, self.poses, self.checks, self.faults = {}, {}, {}, []
        self._runs, self._objectives = {}, {}
        self._hearing = Subscriptions(self, NODE, None, News())
        self._pool = ProcessPoolExecutor(
            1, multiprocessing.get_context("spawn"), initializer=be_quiet
        )
        self.create_timer(0.5, self._look)

    @property
    def warm(self):
        status = self._hearing.status
        return status is not None and status.values["warm"] == "true"

    def begun(self, run, objective):
        """A run began, with the lock held: what stands now stood then."""
        poses = tuple(pose.homogeneous.tobytes() for pose in self.standing.values())
        self._runs[run] = objective, poses
        self.last = run

    def stands(self, run, solution):
        self.standing[run] = self.poses[run][solution]

    def any_solution(self, run, rng):
        known = list(self.poses.get(run, ()))
        return known[rng.integers(len(known))] if known else None

    def refused(self):
        """In words, what the checker says, once all is checked; nobody spins any more."""
        self._look()
        found = {key: future.result() for key, future in self.checks.items()}
        self._pool.shutdown()
        return [f"{key}: {'; '.join(said)}" for key, said in found.items() if said]

    def _look(self):
        # each would do what is called for, and the first answer counts
        self.nodes = max(self.nodes, self.count_services(f"{NODE}/start_with"))
        for run in list(self._runs)[-2:]:
            newest = self._hearing.solution(int(run))
            for number in range(1, 1 + (0 if newest is None else newest.number)):
                solution = self._hearing.solution(int(run), number)
                if solution is not None and f"{run}/{number}" not in self.checks:
                    self._check(run, solution)

    def _check(self, run, solution):
        (objective, placed), key = self._runs[run], f"{run}/{solution.number}"
        self.poses.setdefault(run, {})[solution.number] = pose_of(solution.pose)
        known = self._objectives.setdefault(run, {})
        known[solution.number] = solution.objective
        if sorted(known) != sorted(known, key=known.get) or len(set(known.values())) < len(known):
            self.faults.append(f"objectives of run {run}: {known}")
        names = ("arm", "grasp", "approach_start", "objective")
        manifest = {name: getattr(solution, name) for name in names}
        parts = solution.trajectory, solution.retreat_trajectory, solution.pose
        found = solution_of(OBJECT, manifest, *parts)
        self.checks[key] = self._pool.submit(check, objective, placed, found)


# --- what it costs


class Meter:
    """Memory, threads and descriptors of a process, over time."""

    def __init__(self, pid):
        self._process = psutil.Process(pid)
        self.samples = []

    def read(self, elapsed):
        process = self._process
        memory = process.memory_info().rss
        self.samples.append((elapsed, memory, process.num_threads(), process.num_fds()))

    def judged(self, minutes):
        """Growth of memory, threads and descriptors once settled, all by their least.

        What runs and bodies in the making take for a while comes and goes with them (a fifth of
        the memory); what is kept for ever raises the least too. Of memory, what a tenth of the
        samples are below; in a short soak, whose parts may hold no quiet moment, the most.
        """
        end = 60.0 * minutes
        short = end < 2.0 * MEMORY_SETTLED
        settled = end / 3.0 if short else MEMORY_SETTLED
        window = (end - settled) / (2.0 if short else 4.0)
        table = np.array(self.samples)
        first = table[(table[:, 0] >= settled) & (table[:, 0] < settled + window)]
        last = table[table[:, 0] >= end - window]
        memory = [float(np.percentile(part[:, 1], 100 if short else 10)) for part in (first, last)]
        return {
            "memory_mb": [round(each / 1e6, 1) for each in memory],
            "memory_growth": round(memory[1] / memory[0] - 1.0, 4),
            "threads": [int(part[:, 2].min()) for part in (first, last)],
            "descriptors": [int(part[:, 3].min()) for part in (first, last)],
        }


def faults_of(report, short):
    """Each line of a report that is not as it should be."""
    limit, more = (SHORT_GROWTH, SHORT_MORE) if short else (GROWTH, 0)
    wrong = {
        f"fewer calls than {LEAST_CALLS} an hour": not short
        and report["calls"] < LEAST_CALLS * report["minutes"] / 60.0,
        "calls without an answer": report["unanswered"],
        "solutions that the checker refuses": report["refused"],
        "contradictions": report["contradictions"],
        "tracebacks": report["tracebacks"],
        "no solution was seen": report["solutions"] == 0,
        "other nodes answered, too": report["nodes"] - 1,
        f"memory grew by more than {limit:.0%}": report["memory_growth"] > limit,
        "threads became more": report["threads"][1] > report["threads"][0] + more,
        "descriptors became more": report["descriptors"][1] > report["descriptors"][0] + more,
        "the node did not end by a signal with code 0": report["exit_code"] != 0,
    }
    return [f"{what}: {value}" for what, value in wrong.items() if value]


def soak(minutes, folder, clients=4, seed=0):
    """The report of a soak."""
    rclpy.init()
    log = Path(folder) / "node.log"
    process = start_node(log, "--params-file", str(share_path("config", f"{OBJECT}.yaml")))
    try:
        report = _soak(process, 60.0 * minutes, clients, np.random.SeedSequence(seed))
    finally:
        process.send_signal(signal.SIGINT)
        try:
            code = process.wait(30.0)
        finally:
            process.kill()  # where it has not ended
            rclpy.try_shutdown()
    text = log.read_text(errors="replace")
    report |= {
        "exit_code": code,
        "log_lines": text.count("\n"),
        "tracebacks": text.count("Traceback (most recent call last)"),
    }
    report |= report.pop("meter").judged(minutes)
    return report


def _soak(process, seconds, clients, seeds):
    own = [np.random.default_rng(seed) for seed in seeds.spawn(clients + 1)]
    watcher, world = Watcher(), World(own[0])
    callers = [Caller(i, watcher, own[i + 1]) for i in range(clients)]
    executor = SingleThreadedExecutor()
    for node in (watcher, world, *callers):
        executor.add_node(node)
    spinning = Spinning(executor)
    wait(lambda: watcher.warm or process.poll() is not None, timeout=600.0)
    meter, began = Meter(process.pid), time.monotonic()
    for caller in callers:
        caller.start()
    while (elapsed := time.monotonic() - began) < seconds:
        if process.poll() is not None:
            break
        meter.read(elapsed)
        time.sleep(2.0)
    for caller in callers:
        caller.end()
    lasted = time.monotonic() - began
    spinning.end()
    return {
        "minutes": round(lasted / 60.0, 2),
        "calls": sum(caller.calls for caller in callers),
        "unanswered": [service for caller in callers for service in caller.unanswered],
        "nodes": watcher.nodes,
        "runs": len(watcher._runs),
        "solutions": len(watcher.checks),
        "refused": watcher.refused(),
        "contradictions": watcher.faults,
        "meter": meter,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--clients", type=int, default=4)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path, help="folder to leave the node's log in")
    options = parser.parse_args()
    # a domain that was given may be one that a test claims, whose node would answer, too
    os.environ |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": claimed_domain()}
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.log or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        report = soak(options.minutes, folder, options.clients, options.seed)
    print(json.dumps(report, indent=1))
    wrong = faults_of(report, 60.0 * options.minutes < 2.0 * MEMORY_SETTLED)
    print("\n".join(wrong) or "all is as it should be")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
