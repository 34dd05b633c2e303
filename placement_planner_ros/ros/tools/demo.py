"""`placement_demo`: the main job from end to end, with nothing prepared.

Starts the real node as its own process, publishes a bundled scene as a camera and a robot would,
asks for a placement, prints each improvement, and draws what came of it. Everything happens in
a namespace of its own and on this machine only, so that no real robot hears of it.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import rclpy
import trimesh
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from placement_planner_ros.client import PlacementClient, PlacementError, Solution
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.experiments.cases import start_configuration
from placement_planner_ros.experiments.drawing.picture import draw_objective, draw_placement
from placement_planner_ros.ros.process import begin_ros
from placement_planner_ros.ros.spinning import spin_until
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
PLANNER = f"{NAMESPACE}/placement_planner"
READY_WITHIN = 600.0
"""Seconds within which the node must be ready; after installation it first compiles its kernels."""

LOOK_EVERY = 0.5
"""Seconds between looks at the node while it gets ready."""
PROGRESS_EVERY = 5.0
"""Seconds between lines of how far the node is with getting ready."""


class DemoError(Exception):
    """The demonstration did not get through."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; 0 where a placement was found."""
    options = _parser().parse_args(arguments)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    begin_ros(["--ros-args", "-r", f"__ns:={NAMESPACE}", "--log-level", "warn"])
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
    executor, asked = SingleThreadedExecutor(), threading.Event()
    executor.add_node(scene)
    publishing = threading.Thread(target=spin_until, args=(executor, asked), name="scene")
    publishing.start()
    try:
        with PlacementClient(planner=PLANNER) as planner:
            _converse(options, node, planner, setting)
    finally:
        # In this order: a node that goes while the executor still waits on it is an error.
        asked.set()
        publishing.join()
        executor.shutdown()
        scene.destroy_node()
    return 0


def _converse(
    options: argparse.Namespace,
    node: subprocess.Popen[bytes],
    planner: PlacementClient,
    setting: Setting,
) -> None:
    print(f"{setting.title}, objective {options.objective}")
    print("the node gets ready; the first time after installation this takes a while", flush=True)
    _wait_until_ready(node, planner)
    improvements: list[Solution] = []

    def show(solution: Solution) -> None:
        improvements.append(solution)
        print(
            f"  {solution.search_time:6.2f} s   solution {solution.number:>3}   "
            f"{solution.arm:>5} arm   objective {solution.objective:.4f}",
            flush=True,
        )

    try:
        best = planner.place({}, options.seconds, until=show)
    except PlacementError as error:
        _require_alive(node)
        raise DemoError(str(error)) from error
    if not improvements or improvements[-1].number < best.number:
        show(best)
    print(f"stopped: {best.words}", flush=True)
    _draw(options, improvements, setting)


def _wait_until_ready(node: subprocess.Popen[bytes], planner: PlacementClient) -> None:
    """Tells how far the node is.

    Raises:
        DemoError: it does not get ready.
    """
    give_up, said = time.monotonic() + READY_WITHIN, ""
    say_next = 0.0
    while True:
        try:
            planner.wait_until_ready(LOOK_EVERY)
            return
        except PlacementError as error:
            _require_alive(node)
            if time.monotonic() > give_up:
                raise DemoError(f"the node did not get ready: {error}") from error
        progress = "" if planner.status is None else planner.status.lacking
        if progress not in ("", said) and time.monotonic() > say_next:
            said, say_next = progress, time.monotonic() + PROGRESS_EVERY
            print(f"  {said}", flush=True)


def _require_alive(node: subprocess.Popen[bytes]) -> None:
    if node.poll() is not None:
        raise DemoError(f"the node ended with code {node.returncode}")


def _draw(options: argparse.Namespace, improvements: Sequence[Solution], setting: Setting) -> None:
    best = improvements[-1]
    options.output.mkdir(parents=True, exist_ok=True)
    robot, arm = setting.robot, setting.arm(best.arm)
    last = best.trajectory.points[-1]
    reached = dict(zip(best.trajectory.joint_names, last.positions, strict=True))
    T_tip_object = arm.grasps[best.grasp]
    p, r = best.pose.pose.position, best.pose.pose.orientation
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
        title=f"{setting.title}\n{options.objective}: {best.objective:.4f}",
    )
    draw_objective(
        plot,
        setting.title,
        [(solution.search_time, solution.objective) for solution in improvements],
        end=options.seconds,
        title=options.objective,
    )
    print(f"wrote {picture} and {plot}")


if __name__ == "__main__":
    sys.exit(main())
