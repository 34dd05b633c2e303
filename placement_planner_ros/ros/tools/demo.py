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
from pathlib import Path

import numpy as np
import pinocchio as pin
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from placement_planner_ros.experiments.cases import start_configuration
from placement_planner_ros.experiments.drawing.picture import draw_objective, draw_placement
from placement_planner_ros.ros.process import log_arguments
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.ros.tools.scene_publisher import ScenePublisher
from placement_planner_ros.scenes.objects import OBJECT_NAMES, object_by_name
from placement_planner_ros.scenes.scenes import SCENE_NAMES, scene_by_name
from placement_planner_ros.scenes.yumi import load_yumi, yumi_arm
from placement_planner_ros.share import share_path

NAMESPACE = "/placement_demo"
READY_WITHIN = 600.0
"""Seconds within which the node must be ready; after installation it first compiles its kernels."""


INPUTS_WITHIN = 20.0
"""Seconds within which cloud and joint states must have arrived."""


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
        self.warm = any(v.key == "warm" and v.value == "true" for v in message.values)

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
    node = subprocess.Popen(_node_command(options))
    try:
        return _demonstrate(options, node)
    except DemoError as error:
        print(f"placement_demo: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        node.send_signal(signal.SIGINT)
        try:
            node.wait(10.0)
        except subprocess.TimeoutExpired:
            node.kill()
        rclpy.try_shutdown()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="placement_demo", description=__doc__)
    parser.add_argument("--scene", choices=SCENE_NAMES, default="cabinet_high_clutter")
    parser.add_argument("--object", choices=OBJECT_NAMES, default="small_crayons_box")
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
    volume = scene_by_name(options.scene).volume
    corners = [*volume.lower.tolist(), *volume.upper.tolist()]
    return [
        *command,
        "--ros-args",
        *("-r", f"__ns:={NAMESPACE}"),
        *("--log-level", "warn"),
        *("--params-file", str(share_path("config", f"{options.object}.yaml"))),
        *("-p", f"target_volume:={corners}"),
        *("-p", f"objective:={options.objective}"),
        *("-p", f"seed:={options.seed}"),
        *("-p", "time_limit:=0.0"),
    ]


def _demonstrate(options: argparse.Namespace, node: subprocess.Popen[bytes]) -> int:
    scene = ScenePublisher(
        [
            Parameter("name", value=options.scene),
            Parameter("object", value=options.object),
        ]
    )
    client = Client()
    executor = SingleThreadedExecutor()
    executor.add_node(scene)
    executor.add_node(client)
    try:
        return _converse(options, node, client, executor)
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
) -> int:
    def spin() -> None:
        if node.poll() is not None:
            raise DemoError(f"the node ended with code {node.returncode}")
        executor.spin_once(timeout_sec=0.05)

    print(f"scene {options.scene}, object {options.object}, objective {options.objective}")
    print("the node gets ready; the first time after installation this takes a while", flush=True)
    give_up = time.monotonic() + READY_WITHIN
    while not (client.warm and client.service_ready()):
        spin()
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
    _draw(options, client)
    return 0


def _draw(options: argparse.Namespace, client: Client) -> None:
    assert client.trajectory is not None
    assert client.pose is not None
    options.output.mkdir(parents=True, exist_ok=True)
    robot = load_yumi()
    held = object_by_name(options.object)
    q_start = robot.configuration(start_configuration(options.object))
    reached = dict(
        zip(client.trajectory.joint_names, client.trajectory.points[-1].positions, strict=True)
    )
    arm = yumi_arm(robot, client.manifest["arm"])
    T_tip_object = held.grasps[arm.name][int(client.manifest["grasp"])]
    p, r = client.pose.pose.position, client.pose.pose.orientation
    objective = client.improvements[-1][1]
    picture = options.output / "placement.png"
    plot = options.output / "objective.png"
    draw_placement(
        picture,
        robot=robot,
        q=robot.with_positions(q_start, reached),
        body_vertices=held.vertices,
        body_triangles=held.triangles,
        T_world_object=pin.XYZQUATToSE3(np.array([p.x, p.y, p.z, r.x, r.y, r.z, r.w])),
        scene=scene_by_name(options.scene),
        T_world_start=robot.link_pose(q_start, arm.tip_frame) * T_tip_object,
        hand_links=arm.touch_links,
        title=f"{options.scene}, {options.object}\n{options.objective}: {objective:.4f}",
    )
    draw_objective(
        plot,
        f"{options.scene}, {options.object}",
        client.improvements,
        end=options.seconds,
        title=options.objective,
    )
    print(f"wrote {picture} and {plot}")


if __name__ == "__main__":
    sys.exit(main())
