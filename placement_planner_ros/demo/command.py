"""`placement_demo`: the main job from end to end, with nothing prepared.

Starts the real node as its own process, publishes a bundled scene as a camera and a robot would,
asks for a placement, prints each improvement, and draws what came of it. Everything happens in
a namespace of its own and on this machine only, so that no real robot hears of it.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor

from placement_planner_ros.client import PlacementClient, Solution
from placement_planner_ros.demo.processes import (
    DemoError,
    node_arguments,
    node_running,
    page_served,
)
from placement_planner_ros.demo.results import write_objective_plot, write_pictures, writing_to
from placement_planner_ros.demo.search import Asking
from placement_planner_ros.demo.setting import Setting, bundled, read_setting
from placement_planner_ros.progress import ProgressLine
from placement_planner_ros.ros.process import begin_ros
from placement_planner_ros.ros.spinning import spin_until
from placement_planner_ros.ros.tools.scene_publisher import ScenePublisher
from placement_planner_ros.scenes.objects import BUNDLED_OBJECTS, OBJECT_NAMES
from placement_planner_ros.scenes.scenes import BUNDLED_SCENES

_UPRIGHT = ("toy_table", "wine_glass")
"""What people would not put on its head; on a tour it stands on its feet."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; 0 where a placement was found and drawn."""
    options = _read_options(arguments)
    for each in (signal.SIGINT, signal.SIGTERM):  # a shell's background job ignores the first
        signal.signal(each, signal.default_int_handler)
    line = ProgressLine(pause=5.0)
    try:
        _demonstrate(options, line)
    except DemoError as error:
        line.end()
        print(f"placement_demo: {error}", file=sys.stderr, flush=True)
        return 1
    except KeyboardInterrupt:
        line.end()
        print("placement_demo: interrupted; the node is stopped", file=sys.stderr, flush=True)
        return 128 + signal.SIGINT
    finally:
        rclpy.try_shutdown()
    return 0


def _read_options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="placement_demo", description=__doc__)
    told = "%(default)s; with --tour "
    parser.add_argument(
        "--scene", choices=BUNDLED_SCENES, default="table", help=f"{told}cabinet_low_clutter"
    )
    parser.add_argument(
        "--tour",
        action="store_true",
        help="put objects down one after the other: each is confirmed, and the robot is at its "
        "start again with the next in hand",
    )
    parser.add_argument(
        "--params-file",
        type=Path,
        metavar="FILE",
        help="parameters of your own: another robot with its object, at a table of things "
        "(config/robots has some), or another object for the bundled robot, at --scene",
    )
    parser.add_argument(
        "--object",
        nargs="+",
        choices=BUNDLED_OBJECTS,
        default=["wine_glass"],
        help=f"wine_glass; with --tour {', '.join(OBJECT_NAMES)}",
    )
    parser.add_argument("--objective", default="maximize_clearance")
    parser.add_argument(
        "--seconds", type=float, default=20.0, help=f"time to search: {told}5 for each object"
    )
    parser.add_argument("--seed", type=int, default=-1, help="of the search; -1: another each time")
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="folder")
    parser.add_argument(
        "--view",
        action="store_true",
        help="serve a page that shows the search, to be opened in a browser, until Ctrl-C",
    )
    options = parser.parse_args(arguments)
    if options.tour:
        parser.set_defaults(scene="cabinet_low_clutter", object=OBJECT_NAMES, seconds=5.0)
        options = parser.parse_args(arguments)
    if (len(options.object) > 1) != options.tour or (options.tour and options.params_file):
        parser.error("--tour is for several bundled objects, and they are for it")
    return options


def _demonstrate(options: argparse.Namespace, line: ProgressLine) -> None:
    with writing_to(options.output):
        options.output.mkdir(parents=True, exist_ok=True)
        (options.output / "node.log").touch()
    line.show("  reading robot and object")
    # what is put down, one after the other
    settings = [bundled(options.scene, name) for name in options.object]
    if options.params_file is not None:
        settings = [read_setting(options.params_file, options.scene)]
    # the node's file and what it is told besides
    own = {**settings[0].parameters, "objective": options.objective, "seed": options.seed}
    # a namespace of its own, so that no robot nearby hears
    namespace, log = f"/placement_demo_{os.getpid()}", options.output / "node.log"
    # on this machine only; the processes begun later inherit it
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    begin_ros(["--ros-args", "-r", f"__ns:={namespace}", "--log-level", "warn"])
    told = ", ".join(f"{name} {value}" for name, value in own.items())
    line.say(f"{settings[0].scene.name}: {told}")
    with ExitStack() as running:
        # node, scene and page run until the block is left
        arguments = node_arguments(settings[0].file, own)
        check = running.enter_context(node_running(namespace, arguments, log))
        publisher = running.enter_context(published(settings[0]))
        address = ""
        if options.view:
            address = running.enter_context(page_served(namespace, options.output / "view.log"))
            line.say(f"look at it in a browser: {address}")

        with PlacementClient(planner=f"{namespace}/placement_planner") as planner:
            asking = Asking(planner, check, line)
            line.say("the node gets ready; the first time after installation that takes a while")
            asking.wait_until_ready()
            searches = [
                (setting, put_down(asking, publisher, setting, options)) for setting in settings
            ]
        # drawing takes the processor; with the page open, the node is left running
        if not address:
            running.close()
        still, moving, plot = (
            options.output / name for name in ("placement.png", "motion.gif", "objective.png")
        )
        with writing_to(options.output):
            write_pictures(still, moving, searches, line)
            write_objective_plot(plot, searches, options.objective)
        print("look at:")
        print(f"  {still}   before and after, with the way of the object")
        print(f"  {moving}   the whole motion, release and retreat included")
        print(f"  {plot}   the objective of the best placement over time")
        print(f"  {log}   what the node said")
        if address:
            print(f"the page is there until Ctrl-C: {address}", flush=True)
            with suppress(KeyboardInterrupt):
                signal.pause()


def put_down(
    asking: Asking, publisher: ScenePublisher, setting: Setting, options: argparse.Namespace
) -> list[Solution]:
    """Search for a place for what the robot holds; where it is one of several, it stands there from
    then on, and the robot is at its start with the next one in hand."""
    if not options.tour:
        return asking.search({}, options.seconds, confirm=False)
    asking.line.say(f"the robot is at its start with the {setting.name} in hand")
    # the fingers close on another thing
    publisher.show(setting.positions)
    up = {"object.up": [0.0, 0.0, 1.0]} if setting.file.stem in _UPRIGHT else {}
    return asking.search({**setting.given, **up}, options.seconds, confirm=True)


@contextmanager
def published(setting: Setting) -> Iterator[ScenePublisher]:
    """The node that publishes the scene, on its topics meanwhile."""
    scene = ScenePublisher(own=(setting.scene, setting.positions, setting.robot.root_link))
    executor, asked = SingleThreadedExecutor(), threading.Event()
    executor.add_node(scene)
    thread = threading.Thread(target=spin_until, args=(executor, asked), name="scene")
    thread.start()
    try:
        yield scene
    finally:
        # in this order: a node that goes while the executor still waits on it is an error
        asked.set()
        thread.join()
        executor.shutdown()
        scene.destroy_node()
