"""`placement_view`: serves the page until it is interrupted."""

from __future__ import annotations

import logging
import os
import socket
import sys
import threading
import traceback
from collections.abc import Sequence

import rclpy
import viser
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from placement_planner_ros.client import PlacementClient
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.interrupts import catch_signals
from placement_planner_ros.ros.inputs.transforms import Transforms
from placement_planner_ros.ros.patience import STOP_PATIENCE_S
from placement_planner_ros.ros.process import begin_ros
from placement_planner_ros.ros.spinning import PooledExecutor, spin_until
from placement_planner_ros.view.controls import Controls
from placement_planner_ros.view.listening import Listener
from placement_planner_ros.view.options import make_parser
from placement_planner_ros.view.page import Page
from placement_planner_ros.view.world import World

NICE = 19
"""By how much others go first where the processor is short, as the planner should."""
_UNEXPECTED = (ArithmeticError, LookupError, PlacementPlannerError, TypeError, ValueError)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    asked = catch_signals()
    given = ["placement_view", *(sys.argv[1:] if arguments is None else arguments)]
    options = make_parser().parse_args(remove_ros_args(given)[1:])
    # the planner goes first
    os.nice(NICE)
    fault = _address_fault(options.host, options.port)
    if fault:
        print(f"placement_view: {fault}", file=sys.stderr)
        return 1
    begin_ros(given)
    node = Node("placement_view")
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    server = viser.ViserServer(options.host, options.port, label="placement_view", verbose=False)
    # without --control there is nothing that could command
    client = PlacementClient(node, options.planner) if options.control else None
    listener = Listener(node, options.planner)
    transforms = Transforms(node)
    page = Page(server, listener, World(listener, transforms.pose))
    controls = None
    if client is not None:
        controls = Controls(server, client, lambda: page.record.run, lambda: page.solution)
    # one thread hears, this one draws
    executor, over = PooledExecutor(1), threading.Event()
    executor.add_node(node)

    def survive(error: BaseException) -> None:
        node.get_logger().warning(f"a message was dropped: {type(error).__name__}: {error}")

    told = executor, over, survive
    hearing = threading.Thread(target=spin_until, args=told, name="hearing")
    hearing.start()
    print(f"placement_view: http://{options.host}:{options.port}", flush=True)
    if options.control:
        print("placement_view: whoever opens the page can start and stop runs", flush=True)
    try:
        _show_page(page, listener, controls, asked)
    finally:
        over.set()
        hearing.join()
        server.stop()
        executor.finish(STOP_PATIENCE_S)
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _show_page(
    page: Page, listener: Listener, controls: Controls | None, asked: threading.Event
) -> None:
    """Refresh the page until it is asked to end."""
    known, said = -1, ""
    while not asked.is_set():
        wait = 1.0
        try:
            wait = page.refresh()
            if controls is not None and listener.parameters.count != known:
                known = listener.parameters.count
                controls.know(listener.parameters.values)
        except _UNEXPECTED:  # whatever is heard, the page goes on, and this is said
            fault = traceback.format_exc()
            if fault != said:  # once, not ten times a second
                said = fault
                print(fault, file=sys.stderr, flush=True)
        asked.wait(wait)


def _address_fault(host: str, port: int) -> str:
    """Why nothing can be served there; empty where it can. viser would take another port."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        socket.create_server((host, port), family=family).close()
    except (OSError, OverflowError) as error:
        return f"--host {host} --port {port}: {error}; choose another"
    return ""
