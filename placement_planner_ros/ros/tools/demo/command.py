"""`placement_demo`: the main job from end to end, with nothing prepared.

Starts the real node as its own process, publishes a bundled scene as a camera and a robot would,
asks for a placement, prints each improvement, and draws what came of it. Everything happens in
a namespace of its own and on this machine only, so that no real robot hears of it.
"""

from __future__ import annotations

import argparse
import os
import shlex
import signal
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType

import rclpy
from rclpy.executors import SingleThreadedExecutor

from placement_planner_ros.client import PlacementClient
from placement_planner_ros.progress import ProgressLine
from placement_planner_ros.ros.process import begin_ros
from placement_planner_ros.ros.spinning import spin_until
from placement_planner_ros.ros.tools.demo.errors import DemoError
from placement_planner_ros.ros.tools.demo.node_process import NodeProcess, node_arguments
from placement_planner_ros.ros.tools.demo.results import require_folder, write_results
from placement_planner_ros.ros.tools.demo.search import search, wait_until_ready
from placement_planner_ros.ros.tools.demo.setting import Setting, bundled, of_file
from placement_planner_ros.ros.tools.demo.view_process import page_served, wait_until_interrupted
from placement_planner_ros.scenes.objects import ALL_OBJECTS
from placement_planner_ros.scenes.scenes import SCENE_NAMES

_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; 0 where a placement was found and drawn."""
    options = _parser().parse_args(arguments)
    signal.signal(signal.SIGTERM, _interrupt)
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
        return _INTERRUPTED
    except Exception:  # whatever it is, with all there is to say
        line.end()
        traceback.print_exc()
        print(
            "placement_demo: this should not happen; please report it with the lines above and "
            f"{options.output / 'node.log'}",
            file=sys.stderr,
            flush=True,
        )
        return 1
    finally:
        rclpy.try_shutdown()
    return 0


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="placement_demo", description=__doc__)
    parser.add_argument("--scene", choices=SCENE_NAMES, default="table")
    parser.add_argument(
        "--params-file",
        type=Path,
        metavar="FILE",
        help="parameters of your own: another robot with its object, at a table of things "
        "(config/robots has some), or another object for the bundled robot, at --scene",
    )
    parser.add_argument("--object", choices=ALL_OBJECTS, default="wine_glass")
    parser.add_argument("--objective", default="maximize_clearance")
    parser.add_argument(
        "--seconds",
        type=float,
        default=20.0,
        help="time to search on after the first placement",
    )
    parser.add_argument("--seed", type=int, default=-1, help="of the search; -1: another each time")
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="folder")
    parser.add_argument(
        "--view",
        action="store_true",
        help="serve a page that shows the search, to be opened in a browser, until Ctrl-C",
    )
    return parser


def _demonstrate(options: argparse.Namespace, line: ProgressLine) -> None:
    require_folder(options.output)
    line.show("  reading robot and object")
    chosen = options.params_file
    setting = (
        bundled(options.scene, options.object) if chosen is None else of_file(chosen, options.scene)
    )
    own = {**setting.parameters, "objective": options.objective, "seed": options.seed}
    arguments = node_arguments(setting.file, own)
    namespace = f"/placement_demo_{os.getpid()}"
    _begin(namespace)
    told = ", ".join(f"{name} {value}" for name, value in own.items())
    line.say(f"{setting.title}: {told}")
    log = options.output / "node.log"
    with ExitStack() as running:
        node = running.enter_context(NodeProcess(namespace, arguments, log))
        publishing = running.enter_context(published(setting))
        if options.view:
            address = running.enter_context(page_served(namespace, options.output / "view.log"))
            line.say(f"look at it in a browser: {address}")

        def check() -> None:
            node.require_alive()
            if not publishing.is_alive():
                raise DemoError("the scene is published no more", "the lines above say why")

        with PlacementClient(planner=f"{namespace}/placement_planner") as planner:
            line.say("the node gets ready; the first time after installation that takes a while")
            wait_until_ready(planner, check, line)
            found = search(planner, options.seconds, check, line)
        if not options.view:
            running.close()
        written = write_results(options.output, setting, found, options.objective, line)
        print("look at:")
        for path, words in [*written, (log, "what the node said")]:
            print(f"  {path}   {words}")
        if setting.scene_command:
            print("the same by hand, in two terminals; docs/jazzy.md says what to call in a third:")
            print(f"  {setting.scene_command}")
            print(f"  placement_planner --ros-args {shlex.join(arguments)}", flush=True)
        if options.view:
            print(f"the page is there until Ctrl-C: {address}", flush=True)
            wait_until_interrupted()


def _begin(namespace: str) -> None:
    """Initialise ROS, on this machine only.

    Raises:
        DemoError: it cannot be.
    """
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    arguments = ["--ros-args", "-r", f"__ns:={namespace}", "--log-level", "warn"]
    try:
        begin_ros(arguments)
    except Exception as error:  # rclpy's own kinds, none of which is public
        raise DemoError(
            f"ROS does not start: {error}",
            "unset RMW_IMPLEMENTATION and ROS_DOMAIN_ID, or give values that fit this installation",
        ) from error


@contextmanager
def published(setting: Setting) -> Iterator[threading.Thread]:
    """The scene on its topics meanwhile; the thread that publishes it."""
    scene = setting.publisher()
    executor, asked = SingleThreadedExecutor(), threading.Event()
    executor.add_node(scene)
    publishing = threading.Thread(target=spin_until, args=(executor, asked), name="scene")
    publishing.start()
    try:
        yield publishing
    finally:
        # In this order: a node that goes while the executor still waits on it is an error.
        asked.set()
        publishing.join()
        executor.shutdown()
        scene.destroy_node()


if __name__ == "__main__":
    sys.exit(main())
