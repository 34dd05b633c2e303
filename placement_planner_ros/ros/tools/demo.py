"""`placement_demo`: the main job from end to end, with nothing prepared.

Starts the real node as its own process, publishes a bundled scene as a camera and a robot would,
calls start, prints each improvement, calls stop, and draws what came of it. Everything happens in
a namespace of its own and on this machine only, so that no real robot hears of it.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import rclpy
import trimesh
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.experiments.cases import start_configuration
from placement_planner_ros.experiments.drawing.picture import draw_objective, draw_placement
from placement_planner_ros.ros.process import log_arguments
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.ros.tools.robot_check.findings import Findings
from placement_planner_ros.ros.tools.robot_check.given import read_given, start_in
from placement_planner_ros.ros.tools.robot_check.subject import read_subject
from placement_planner_ros.ros.tools.scene_publisher import ScenePublisher
from placement_planner_ros.ros.tools.things_publisher import ThingsPublisher
from placement_planner_ros.scenes.objects import ALL_OBJECTS, object_by_name
from placement_planner_ros.scenes.scenes import SCENE_NAMES, Scene, scene_by_name
from placement_planner_ros.scenes.table_of_things import table_of_things
from placement_planner_ros.scenes.yumi import load_yumi, yumi_arm
from placement_planner_ros.share import share_path

NAMESPACE = "/placement_demo"
READY_WITHIN = 600.0
"""Seconds within which the node must be ready; after installation it first compiles its kernels."""


INPUTS_WITHIN = 20.0
"""Seconds within which cloud and joint states must have arrived."""


PROGRESS_EVERY = 5.0
"""Seconds between lines of how far the node is with getting ready."""


class DemoError(Exception):
    """The demonstration did not get through."""


class Client(Node):
    """Calls the node's services and keeps its results."""

    def __init__(self) -> None:
        super().__init__("placement_client", namespace=NAMESPACE)
        self.improvements: list[tuple[float, float]] = []
        self.trajectory: JointTrajectory | None = None
        self.pose: PoseStamped | None = None
        self.manifest: dict[str, str] = {}
        self.warm = False
        self.progress = ""
        self._start = self.create_client(Trigger, "placement_planner/start")
        self._stop = self.create_client(Trigger, "placement_planner/stop")
        self.create_subscription(
            JointTrajectory, "placement_planner/trajectory", self._on_trajectory, LATCHED
        )
        self.create_subscription(
            PoseStamped, "placement_planner/placement_pose", self._on_pose, LATCHED
        )
        self.create_subscription(
            DiagnosticArray, "placement_planner/solution", self._on_solution, LATCHED
        )
        self.create_subscription(
            DiagnosticStatus, "placement_planner/status", self._on_status, LATCHED
        )

    def _on_status(self, message: DiagnosticStatus) -> None:
        values = {v.key: v.value for v in message.values}
        self.warm = values.get("warm") == "true"
        told = [values.get(f"{what}_progress", "") for what in ("robot", "object", "warm")]
        self.progress = next(filter(None, told), "")

    def _on_trajectory(self, message: JointTrajectory) -> None:
        if message.points:
            self.trajectory = message

    def _on_pose(self, message: PoseStamped) -> None:
        self.pose = message

    def _on_solution(self, message: DiagnosticArray) -> None:
        values = {v.key: v.value for v in message.status[0].values}
        if values["solution"] == "0":
            return
        search_time, objective = float(values["search_time"]), float(values["objective"])
        self.improvements.append((search_time, objective))
        self.manifest = values
        print(
            f"  {search_time:6.2f} s   solution {values['solution']:>3}   {values['arm']:>5} arm   "
            f"objective {objective:.4f}",
            flush=True,
        )

    def call(self, client_name: str, spin: Callable[[], None]) -> Trigger.Response:
        """Call start or stop and wait for the answer.

        Raises:
            DemoError: none came.
        """
        client = {"start": self._start, "stop": self._stop}[client_name]
        future = client.call_async(Trigger.Request())
        give_up = time.monotonic() + 10.0
        while not future.done():
            if time.monotonic() > give_up:
                raise DemoError(f"the node does not answer {client_name}")
            spin()
        result: Trigger.Response = future.result()
        return result

    def service_ready(self) -> bool:
        """Whether the node is there."""
        return bool(self._start.service_is_ready())


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; 0 where a placement was found."""
    options = _parser().parse_args(arguments)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    here = ["--ros-args", "-r", f"__ns:={NAMESPACE}", "--log-level", "warn"]
    rclpy.init(args=[*here, *log_arguments()])
    node: subprocess.Popen[bytes] | None = None
    try:
        setting = _setting(options)
        node = subprocess.Popen(_node_command(options))
        return _demonstrate(options, node, setting)
    except DemoError as error:
        print(f"placement_demo: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        if node is not None:
            node.send_signal(signal.SIGINT)
            try:
                node.wait(10.0)
            except subprocess.TimeoutExpired:
                node.kill()
        rclpy.try_shutdown()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="placement_demo", description=__doc__)
    parser.add_argument("--scene", choices=SCENE_NAMES, default="cabinet_high_clutter")
    parser.add_argument(
        "--params-file",
        type=Path,
        metavar="FILE",
        help="another robot, with its object, at a table of things instead of scene and object: "
        "config/robots has some",
    )
    parser.add_argument("--object", choices=ALL_OBJECTS, default="small_crayons_box")
    parser.add_argument("--objective", default="maximize_clearance")
    parser.add_argument("--seconds", type=float, default=20.0, help="time to search")
    parser.add_argument("--seed", type=int, default=-1)
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="folder")
    return parser


def _node_command(options: argparse.Namespace) -> list[str]:
    """The installed node with the object's parameter file and the scene's volume."""
    beside = Path(sys.executable).parent
    installed = shutil.which("placement_planner", path=f"{beside}{os.pathsep}{os.environ['PATH']}")
    command = [installed] if installed else [sys.executable, "-m", "placement_planner_ros.ros.node"]
    if options.params_file is not None:
        own = ["--params-file", str(options.params_file)]
    else:
        volume = scene_by_name(options.scene).volume
        corners = [*volume.lower.tolist(), *volume.upper.tolist()]
        own = ["--params-file", str(share_path("config", f"{options.object}.yaml"))]
        own += ["-p", f"target_volume:={corners}"]
    return [
        *command,
        "--ros-args",
        *("-r", f"__ns:={NAMESPACE}"),
        *("--log-level", "warn"),
        *own,
        *("-p", f"objective:={options.objective}"),
        *("-p", f"seed:={options.seed}"),
        *("-p", "time_limit:=0.0"),
    ]


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """What the demonstration is about.

    Attributes:
        title: of pictures and lines.
        publisher: makes the node that publishes the scene and the robot's joint states.
        q_start: (nq,) where the robot stands.
        arm: by name.
        vertices, triangles: (n, 3) and (t, 3) of the object.
    """

    title: str
    scene: Scene
    publisher: Callable[[], Node]
    robot: Robot
    q_start: Array
    arm: Callable[[str], Arm]
    vertices: Array
    triangles: npt.NDArray[np.int64]


def _setting(options: argparse.Namespace) -> Setting:
    """The bundled robot at a bundled scene, or another at a table of things.

    Raises:
        DemoError: something is wrong with the other one.
    """
    if options.params_file is not None:
        return _robot_setting(options.params_file)
    held, robot = object_by_name(options.object), load_yumi()

    def publisher() -> Node:
        given = {"name": options.scene, "object": options.object}
        return ScenePublisher([Parameter(name, value=value) for name, value in given.items()])

    return Setting(
        f"{options.scene}, {options.object}",
        scene_by_name(options.scene),
        publisher,
        robot,
        robot.configuration(start_configuration(options.object)),
        lambda name: yumi_arm(robot, name, held.grasps[name]),
        held.vertices,
        held.triangles,
    )


def _robot_setting(file: Path) -> Setting:
    print(f"reading {file}", flush=True)
    findings = Findings()
    given = read_given(file, {}, findings)
    subject = None if findings.faults else read_subject(given, None, findings, start_in(file))
    if findings.faults or subject is None or subject.body is None:
        raise DemoError("; ".join([*findings.faults, "placement_check_robot says more"]))
    scene, arms, body = (
        table_of_things(subject.parameters.volume),
        {arm.name: arm for arm in subject.arms},
        subject.body,
    )
    hull = trimesh.convex.convex_hull(body.vertices)
    return Setting(
        f"{subject.robot.name}, table of things",
        scene,
        lambda: ThingsPublisher(scene, subject),
        subject.robot,
        subject.q,
        arms.__getitem__,
        np.asarray(hull.vertices),
        np.asarray(hull.faces, dtype=np.int64),
    )


def _demonstrate(
    options: argparse.Namespace, node: subprocess.Popen[bytes], setting: Setting
) -> int:
    scene = setting.publisher()
    client = Client()
    executor = SingleThreadedExecutor()
    executor.add_node(scene)
    executor.add_node(client)
    try:
        return _converse(options, node, client, executor, setting)
    finally:
        # In this order: a node that goes while the executor still waits on it is an error.
        executor.shutdown()
        client.destroy_node()
        scene.destroy_node()


def _converse(
    options: argparse.Namespace,
    node: subprocess.Popen[bytes],
    client: Client,
    executor: SingleThreadedExecutor,
    setting: Setting,
) -> int:
    def spin() -> None:
        if node.poll() is not None:
            raise DemoError(f"the node ended with code {node.returncode}")
        executor.spin_once(timeout_sec=0.05)

    print(f"{setting.title}, objective {options.objective}")
    print("the node gets ready; the first time after installation this takes a while", flush=True)
    give_up, said, say_next = time.monotonic() + READY_WITHIN, "", 0.0
    while not (client.warm and client.service_ready()):
        spin()
        if client.progress not in ("", said) and time.monotonic() > say_next:
            said, say_next = client.progress, time.monotonic() + PROGRESS_EVERY
            print(f"  {said}", flush=True)
        if time.monotonic() > give_up:
            raise DemoError(f"the node did not get ready within {READY_WITHIN:g} s")
    give_up = time.monotonic() + INPUTS_WITHIN
    while not (answer := client.call("start", spin)).success:
        spin()
        if time.monotonic() > give_up:
            raise DemoError(f"start was refused:\n{answer.message}")
    print(f"start: {answer.message.splitlines()[0]}", flush=True)
    end = time.monotonic() + options.seconds
    while time.monotonic() < end:
        spin()
    answer = client.call("stop", spin)
    print(f"stop: {answer.message}", flush=True)
    for _ in range(5):
        spin()
    if client.trajectory is None or client.pose is None:
        return 1
    _draw(options, client, setting)
    return 0


def _draw(options: argparse.Namespace, client: Client, setting: Setting) -> None:
    assert client.trajectory is not None
    assert client.pose is not None
    options.output.mkdir(parents=True, exist_ok=True)
    robot, arm = setting.robot, setting.arm(client.manifest["arm"])
    reached = dict(
        zip(client.trajectory.joint_names, client.trajectory.points[-1].positions, strict=True)
    )
    T_tip_object = arm.grasps[int(client.manifest["grasp"])]
    p, r = client.pose.pose.position, client.pose.pose.orientation
    objective = client.improvements[-1][1]
    picture = options.output / "placement.png"
    plot = options.output / "objective.png"
    draw_placement(
        picture,
        robot=robot,
        q=robot.with_positions(setting.q_start, reached),
        body_vertices=setting.vertices,
        body_triangles=setting.triangles,
        T_world_object=pin.XYZQUATToSE3(np.array([p.x, p.y, p.z, r.x, r.y, r.z, r.w])),
        scene=setting.scene,
        T_world_start=robot.link_pose(setting.q_start, arm.tip_frame) * T_tip_object,
        hand_links=arm.touch_links,
        title=f"{setting.title}\n{options.objective}: {objective:.4f}",
    )
    draw_objective(
        plot,
        setting.title,
        client.improvements,
        end=options.seconds,
        title=options.objective,
    )
    print(f"wrote {picture} and {plot}")


if __name__ == "__main__":
    sys.exit(main())
