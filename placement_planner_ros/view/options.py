"""The command line of `placement_view`; needs neither ROS nor viser."""

from __future__ import annotations

import argparse

PORT = 8080
_ABOUT = """Shows what a placement planner's node is doing, as a page in the browser.

The page only shows, unless --control is given. Run it in the node's namespace, or say with
--planner which node is meant."""


def make_parser() -> argparse.ArgumentParser:
    """Of all but ROS's own arguments."""
    made = argparse.ArgumentParser(
        prog="placement_view",
        description=_ABOUT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="ROS's own arguments go after --ros-args, such as -r __ns:=/cell_2.",
    )
    made.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to serve on; 127.0.0.1 is this machine only, 0.0.0.0 is whoever can reach it",
    )
    made.add_argument("--port", type=int, default=PORT, help=f"port to serve on; without it {PORT}")
    made.add_argument(
        "--control",
        action="store_true",
        help="let whoever opens the page start, stop and confirm, and set parameters",
    )
    made.add_argument(
        "--planner",
        default="placement_planner",
        metavar="NODE",
        help="name of the planning node; without it placement_planner",
    )
    return made
