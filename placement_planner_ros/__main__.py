"""`python -m placement_planner_ros PROGRAM ...`: the programs, which the console scripts start too.

The core is all that `pip install .` brings. Where a program lacks what it needs besides, it says in
one line which command installs that.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

from placement_planner_ros.heaps import share_heaps
from placement_planner_ros.interrupts import catch_signals, ended_while_loading

PACKAGE = "placement_planner_ros"
ROS_REMEDY = f"run pip install '{PACKAGE}[ros]', or source a ROS 2 Jazzy"
VIEW_REMEDY = (
    f"run pip install '{PACKAGE}[ros,view]'; where a ROS 2 Jazzy is sourced, '{PACKAGE}[view]'"
)


_NODE_HELP = f"""usage: placement_planner [--compile] [--ros-args --params-file FILE]

The node: waits for clouds and joint states, and plans when ~/start is called. Without arguments
it plans for the bundled robot, and wants an object. --compile compiles all beforehand, and ends.
Parameters: docs/parameters.md of {PACKAGE}; topics and services: docs/interface.md."""
_SCENE_HELP = """usage: placement_scene [--ros-args [-p PARAMETER:=VALUE] ...]

Publishes a bundled scene as cameras and the bundled robot would, until interrupted.

parameters:
  name     cabinet_high_clutter (default), cabinet_low_clutter, table, shelf
  object   that the fingers are closed around: small_crayons_box (default), large_crayons_box,
           wine_glass, toy_table, book
  clouds   complete (default): the whole surface, on `points`, in the robot's frame;
           cameras: what two depth cameras see, on `camera_left/points` and `camera_right/points`,
           in their frames, which config/cabinet_cameras.yaml, table_ and shelf_ give the node
  rate     clouds a second: 2.0 (default), up to 100

It publishes `joint_states`, `robot_description` and `robot_description_semantic`, too.

example:
  placement_scene --ros-args -p name:=table -p object:=wine_glass
and in another terminal, with the files of this package's config:
  placement_planner --ros-args --params-file wine_glass.yaml --params-file table.yaml

For the joint states alone, beside a cloud of your own: --ros-args -r points:=unused"""


def _start(program: str, module: str, remedy: str, until_signal: bool = False) -> Any:
    """Run a program's main.

    Args:
        until_signal: whether it runs until a signal ends it, which is no fault then.
    """
    if until_signal:
        catch_signals()
    with ended_while_loading(0 if until_signal else None):
        share_heaps()
        # Before numba is imported.
        import_module(f"{PACKAGE}.core.kernels").use_kernel_folder()
        try:
            main = import_module(f"{PACKAGE}.{module}").main
        except ModuleNotFoundError as error:
            if error.name is None or error.name.split(".")[0] == PACKAGE:
                raise
            sys.exit(f"{program}: {error.name} is missing; {remedy}")
    return main()


def placement_planner() -> Any:
    """The node; or, with `--compile`, what makes it start quickly."""
    if "--compile" in sys.argv[1:]:
        with ended_while_loading():
            compile_all = import_module(f"{PACKAGE}.compile").main
        return compile_all()
    _require_ros_only("placement_planner", _NODE_HELP)
    return _start("placement_planner", "ros.node", ROS_REMEDY, until_signal=True)


def placement_scene() -> Any:
    """A bundled scene as cameras and a robot would publish it."""
    _require_ros_only("placement_scene", _SCENE_HELP)
    return _start("placement_scene", "ros.tools.scene_publisher", ROS_REMEDY, until_signal=True)


def placement_view() -> Any:
    """A page in the browser that shows what the node does."""
    if _asks_for_help():
        return print(import_module(f"{PACKAGE}.view.options").make_parser().format_help(), end="")
    return _start("placement_view", "view.command", VIEW_REMEDY, until_signal=True)


def _require_ros_only(program: str, help_text: str) -> None:
    if _asks_for_help():
        sys.exit(print(help_text))
    if len(sys.argv) > 1 and sys.argv[1] != "--ros-args":
        sys.exit(f"{program}: {sys.argv[1]} is not known; all but --help goes after --ros-args")


def _asks_for_help() -> bool:
    return not {"-h", "--help"}.isdisjoint(sys.argv[1:])


placement_demo = partial(_start, "placement_demo", "demo.command", ROS_REMEDY)
placement_check_robot = partial(
    _start, "placement_check_robot", "ros.tools.robot_check", ROS_REMEDY
)

if __name__ == "__main__":
    by_name: dict[str, Callable[[], Any]] = {
        "placement_planner": placement_planner,
        "placement_demo": placement_demo,
        "placement_scene": placement_scene,
        "placement_check_robot": placement_check_robot,
        "placement_view": placement_view,
    }
    if len(sys.argv) < 2 or sys.argv[1] not in by_name:
        sys.exit(f"usage: python -m {PACKAGE} {{{','.join(by_name)}}} ...")
    sys.exit(by_name[sys.argv.pop(1)]())
