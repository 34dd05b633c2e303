"""The node `placement_planner`: inputs, runs and outputs put together."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin
import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.warmup import warm_up
from placement_planner_ros.interrupts import catch_signals
from placement_planner_ros.ros.commands import STOP_PATIENCE, Commands
from placement_planner_ros.ros.inputs import point_cloud
from placement_planner_ros.ros.inputs.frames import Transforms
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.inputs.reception import Reception
from placement_planner_ros.ros.inputs.resources import Files
from placement_planner_ros.ros.inputs.robot_input import RobotInput, make_arms
from placement_planner_ros.ros.inputs.self_filter import outside_robot
from placement_planner_ros.ros.outputs.announcer import Announcer
from placement_planner_ros.ros.outputs.publishing import Outputs
from placement_planner_ros.ros.outputs.reporting import Reporter
from placement_planner_ros.ros.parameters.server import ParameterServer
from placement_planner_ros.ros.process import (
    leave_at_once,
    share_among_threads,
    spare_what_is_loaded,
)
from placement_planner_ros.ros.run import surroundings
from placement_planner_ros.ros.run.planning import Prepare
from placement_planner_ros.ros.run.preparation import Preparation
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.start_checks import take_snapshot
from placement_planner_ros.ros.run.worker import State
from placement_planner_ros.ros.services import answer_always, serve
from placement_planner_ros.ros.spinning import PooledExecutor, spin_until

THREADS = 6
START_UP_PATIENCE = 5.0
"""Seconds that the node waits for robot and object to be read before it offers its services."""


class PlacementPlannerNode(Node):
    """ROS around the planner.

    Args:
        prepare: makes the planner of a run, other than the usual one.
        overrides: parameter values, as given on the command line.

    Raises:
        PlacementPlannerError: a parameter or the robot description is bad at start-up.
    """

    def __init__(self, prepare: Prepare | None = None, overrides: Sequence[Parameter] = ()) -> None:
        super().__init__("placement_planner", parameter_overrides=list(overrides))
        self._settings = ParameterServer(self)
        parameters = self._settings.current
        transforms = Transforms(self)
        files = Files.below(parameters["package_paths"], parameters["file_roots"])
        robot = RobotInput(parameters, transforms.pose, files)
        extra = parameters["cloud_topics"]
        self._inputs = Inputs(
            robot, parameters, extra or ["points"], transforms, self.get_clock(), files
        )
        self._warm = threading.Event()
        outputs = Outputs(self)
        self._reporter = Reporter(
            self, outputs, self._inputs, self._settings, self._warm.is_set, self._watching_failed
        )
        self._preparation = Preparation(self._newest, self._has_leisure, self._preparing_failed)
        self._commands = Commands(
            self._inputs,
            self._settings,
            prepare or self._preparation.prepare,
            self._preparation.ready,
            Announcer(self, outputs, self._reporter),
            self._warm,
        )
        topics = list(dict.fromkeys(["points", *extra]))
        self._reception = Reception(
            self, self._inputs, self._settings, topics, self._end_where_robot_moved
        )
        # Nobody calls yet, so nobody waits; who calls first should find it read.
        robot.wait(START_UP_PATIENCE)
        self._inputs.object.wait(START_UP_PATIENCE)
        serve(self, self._commands)
        answer_always(self, self._internal)
        self.get_logger().info("ready: start and the other services are offered")

    def _internal(self, error: BaseException) -> None:
        trace = "".join(traceback.format_exception(error))
        self.get_logger().error(f"a request met a fault: {trace}")

    def _preparing_failed(self, error: Exception) -> None:
        trace = "".join(traceback.format_exception(error))
        self.get_logger().error(f"preparing ahead failed; it goes on with the next inputs: {trace}")

    def _watching_failed(self, error: Exception) -> None:
        trace = "".join(traceback.format_exception(error))
        self.get_logger().error(f"the best placement cannot be held against clouds: {trace}")

    def _end_where_robot_moved(self) -> None:
        run = self._commands.run
        if run is not None and self._reporter.has_left_start(run):
            run.end(State.ROBOT_MOVED)

    def _newest(self) -> tuple[object, Callable[[], Snapshot | None]]:
        """What tells the inputs of now from others, and what takes their snapshot."""
        parameters = self._settings.current

        def take() -> Snapshot | None:
            snapshot = take_snapshot(self._inputs, parameters)
            return None if isinstance(snapshot, list) else snapshot

        return self._inputs.state(parameters), take

    def _has_leisure(self) -> bool:
        return self._warm.is_set() and not self._commands.busy

    def warm_up(self) -> None:
        """Compile, or load, what a search needs, before somebody waits for it."""
        try:
            self._inputs.robot.wait()
            robot = self._inputs.robot.robot
            q = pin.neutral(robot.model)
            outside_robot(np.zeros((1, 3)), robot, q, (), None, 0.0)
            point_cloud.warm_up()
            surroundings.warm_up()
            warm_up(robot, make_arms(robot, self._settings.current), q)
        except PlacementPlannerError as error:
            self.get_logger().warning(f"no search is possible yet: {error}")
        finally:
            self._warm.set()
            self._preparation.start()

    def survive(self, error: Exception) -> None:
        """A callback raised: that must be said, but need not end the node."""
        trace = "".join(traceback.format_exception(error))
        self.get_logger().error(f"a message or a request was dropped: {trace}")

    @property
    def working(self) -> bool:
        """Whether any thread of its own is still at work."""
        return (
            self._commands.busy
            or self._preparation.busy
            or self._inputs.reading
            or self._reporter.busy
        )

    def close(self) -> None:
        """End the run, if there is one, and publish nothing from now on."""
        self._inputs.close()
        self._commands.close()
        self._preparation.close()
        self._reporter.close()


def _warm_up(node: PlacementPlannerNode) -> None:
    node.warm_up()
    spare_what_is_loaded()


def main(args: list[str] | None = None) -> None:
    """Run the node until interrupted."""
    share_among_threads()
    asked = catch_signals()
    if asked.is_set():
        return  # while this was loaded
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = PlacementPlannerNode()
    except (PlacementPlannerError, ParameterException, NameValidationException) as error:
        sys.exit(f"placement_planner: {error}")
    executor = PooledExecutor(THREADS)
    executor.add_node(node)
    warming = threading.Thread(target=_warm_up, args=(node,), name="warm-up", daemon=True)
    warming.start()
    spin_until(executor, asked, node.survive)
    node.close()
    working = not executor.finish(STOP_PATIENCE) or warming.is_alive() or node.working
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
    if working:
        leave_at_once()


if __name__ == "__main__":
    main()
