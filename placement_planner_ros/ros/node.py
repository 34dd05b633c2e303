"""The node `placement_planner`: inputs, runs and outputs put together."""

from __future__ import annotations

import faulthandler
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial

import pinocchio as pin
import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.parameter import Parameter

from placement_planner_ros.core.disk_cache import TROUBLES
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.stopping import StoppedError, stoppable
from placement_planner_ros.core.warmup.compiling import CompilationError, compile_kernels
from placement_planner_ros.core.warmup.warm_up import warm_up
from placement_planner_ros.interrupts import catch_signals
from placement_planner_ros.ros.call_priority import CallPriority
from placement_planner_ros.ros.commands import Commands
from placement_planner_ros.ros.inputs.cloud_subscriptions import LATE_S
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.inputs.object_input import ObjectInput
from placement_planner_ros.ros.inputs.reception import Reception
from placement_planner_ros.ros.inputs.robot_input import RobotInput, announced, make_arm
from placement_planner_ros.ros.inputs.transforms import Transforms
from placement_planner_ros.ros.log import Log
from placement_planner_ros.ros.node_words import in_node_words
from placement_planner_ros.ros.outputs.publishing import Outputs
from placement_planner_ros.ros.outputs.reporting import Reporter
from placement_planner_ros.ros.parameters.server import ParameterNode, ParameterServer
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.patience import LOOK_S, STOP_PATIENCE_S
from placement_planner_ros.ros.process import begin_ros, leave_at_once
from placement_planner_ros.ros.run.preparation import Preparation, Prepare
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.start_checks import take_snapshot
from placement_planner_ros.ros.run.worker import State, Warmth
from placement_planner_ros.ros.services import answer_always, serve
from placement_planner_ros.ros.spinning import PooledExecutor, spin_until, survive

SWITCH_INTERVAL_S = 3e-5
"""After which a thread yields the interpreter to one that waits, as the search does after each
kernel: by the 5 ms that Python waits otherwise it drew 23 % fewer samples a second."""
START_UP_PATIENCE_S = 5.0
"""That the node waits for robot and object to be read before it offers its services, and for what
prepares for the first inputs before it says that all is warm."""


class PlacementPlannerNode(ParameterNode):
    """ROS around the planner.

    Args:
        prepare: makes the planner of a run, other than the usual one.
        overrides: parameter values, as given on the command line.
        asked: set once it is to end, be it before it is made.

    Attributes:
        calls: those that are being answered; whoever spins it tells of them.
        survive: told of what a callback raises, which need not end the node.

    Raises:
        PlacementPlannerError: a parameter or the robot description is bad at start-up.
    """

    def __init__(
        self,
        prepare: Prepare | None = None,
        overrides: Sequence[Parameter] = (),
        asked: threading.Event | None = None,
    ) -> None:
        super().__init__("placement_planner", overrides)
        self._log = Log(self.get_logger())
        self.survive = partial(self._log.fault, "a message or a request was dropped")
        # trouble with what is kept on disk is said here, and ends nothing
        TROUBLES.listen(self._log.failure)
        # parameters first, as everything else is made of them
        self._settings = ParameterServer(self)
        for name, words in self._settings.without_effect().items():
            self._log.warn(f"parameter without effect: {name}: {words}")
        parameters = self._settings.current
        transforms = Transforms(self, parameters["frame_prefix"])
        extra = parameters["cloud_topics"]
        self._inputs = Inputs(
            parameters, extra or ["points"], transforms, self.get_clock(), self._log
        )
        self.calls = CallPriority()
        self._closed = threading.Event()
        self._warm = Warmth()
        self._reporter = Reporter(
            self, Outputs(self), self._inputs, self._settings, self._warm, self._log
        )
        failed = partial(self._log.fault, "preparing ahead failed; it goes on with the next inputs")
        self._preparation = Preparation(self._newest, self._has_leisure, failed, self.calls)
        self._commands = Commands(
            self._inputs,
            self._settings,
            prepare or self._preparation.prepare,
            self._preparation.ready,
            self._reporter,
            self._warm,
        )
        # made last, as what it receives may end a run, which the commands know
        self._reception = Reception(
            self, self._inputs, self._settings, self._end_where_robot_moved, self._log, self.calls
        )
        # Nobody calls yet, so nobody waits; who calls first should find it read.
        for each in (self._inputs.robot, self._inputs.object):
            _wait_for(each, asked or self._closed)
        serve(self, self._commands)
        # after all services are there, rclpy's own among them, as each is wrapped
        answer_always(self, self._log)
        self._log.event("ready: start and the other services are offered")

    def _end_where_robot_moved(self) -> None:
        run = self._commands.run
        left = "" if run is None else self._reporter.left_start(run)
        # a motion that begins at q_0 is worth nothing once the robot is elsewhere
        if run is not None and left:
            run.end(State.ROBOT_MOVED, left)

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
        """Compile, or load, what a search needs, before somebody waits for it.

        Where robot and arms do not do for that, once others are given.
        """
        while not self._closed.is_set():
            # read before the attempt, so that what comes meanwhile leads to another one
            given = self._movable()
            unfit = survive(self._warm_up, self._warming_failed)
            # also where it failed: from now on runs compile what they lack
            if not self._warm.is_set():
                self._warm.set()
                self._preparation.start()
            if not unfit:
                return
            # another robot, or other parameters, must come before another attempt is worth it
            while self._movable() == given and not self._closed.wait(LOOK_S):
                pass

    def _warming_failed(self, error: BaseException) -> None:
        self._warm.failure = f"{type(error).__name__}: {error}"
        self._log.fault("warming up failed; runs compile what they need as they go", error)

    def _warm_up(self) -> bool:
        """Load it; whether robot and arms do not do for that."""
        began = time.monotonic()
        try:
            self._load()
        except StoppedError:
            return False
        except PlacementPlannerError as error:
            self._warm.failure = str(error)
            self._log.repeats("no search is possible yet", str(error))
            return True
        # an attempt with another robot may have failed before
        self._warm.failure = ""
        seconds = time.monotonic() - began
        self._log.event(f"warm: what a search needs is loaded after {seconds:.1f} s")
        return False

    def _load(self) -> None:
        # kernels need no robot, so they are compiled while its description is read
        self._compile()
        self._inputs.robot.wait()
        robot = self._inputs.robot.robot
        q = pin.neutral(robot.model)
        parameters = self._settings.current
        arms = tuple(make_arm(robot, parameters, name) for name in parameters["arms"])
        for arm in arms:
            chain = f"arm {arm.name}: {arm.dof} joints: {', '.join(arm.joints)}"
            self._log.event("; ".join([chain, *announced(robot, parameters, arm)]))
        # beside loading kernels, so that the first start finds all prepared
        first = threading.Thread(target=self._prepare_first, name="first inputs", daemon=True)
        first.start()
        warm_up(robot, arms, q)
        # not for ever: a run that is started waits for what is left of it
        first.join(START_UP_PATIENCE_S)

    def _prepare_first(self) -> None:
        """Prepare for the first inputs, so that a run told to start once all is warm finds it done.

        They are waited for, as clouds and joint states come a moment after the node does.
        """
        latest = time.monotonic() + LATE_S
        while not self._preparation.look():
            if time.monotonic() > latest or self._closed.wait(LOOK_S):
                return

    def _compile(self) -> None:
        """In other processes, where kernels have not been compiled yet."""

        def told(done: int, kernels: int) -> None:
            self._warm.progress = f"{done} of {kernels} kernels compiled"
            words = f"compiling, once for this machine: {self._warm.progress}"
            self.get_logger().info(words, throttle_duration_sec=10.0)

        try:
            # compiling may take minutes, and the node may be told to end meanwhile
            with stoppable(self._closed.is_set):
                compile_kernels(told)
        except CompilationError as error:
            self._log.warn(f"each process compiles its kernels: {error}")
        finally:
            self._warm.progress = ""

    def _movable(self) -> tuple[object, ParameterSet]:
        """What tells robot and arms from others."""
        return self._inputs.robot.key, self._settings.current

    def close(self) -> None:
        """End the run, if there is one, and publish nothing from now on."""
        # in this order: nothing new begins, the run ends, then nobody publishes any more
        self._closed.set()
        for reading in self._inputs.readings:
            reading.close()
        self._commands.close()
        self._preparation.close()
        self._reporter.close()


def _wait_for(given: RobotInput | ObjectInput, asked: threading.Event) -> None:
    """Until it is read, cannot be, or takes too long."""
    latest = time.monotonic() + START_UP_PATIENCE_S
    while given.state == "reading" and time.monotonic() < latest and not asked.is_set():
        given.wait(LOOK_S)


def main(args: list[str] | None = None) -> None:
    """Run the node until interrupted."""
    faulthandler.enable()  # a crash in compiled code says what each thread was doing
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    # before ROS is initialised, which here brings no handlers of its own
    asked = catch_signals()
    if asked.is_set():
        return  # while this was loaded
    try:
        begin_ros(args)
    except RuntimeError as error:  # arguments or a params file that rcl cannot read
        sys.exit(f"placement_planner: {error}")
    try:
        node = PlacementPlannerNode(asked=asked)
    except (PlacementPlannerError, ParameterException, NameValidationException) as error:
        sys.exit(in_node_words(f"placement_planner: {error}"))
    executor = PooledExecutor(6, node.calls)
    executor.add_node(node)
    # beside the executor, so that services answer while kernels are compiled
    warming = threading.Thread(target=node.warm_up, name="warm-up", daemon=True)
    warming.start()
    spin_until(executor, asked, node.survive)
    node.close()
    # callbacks in flight use the node, so they end before it is destroyed
    executor.finish(STOP_PATIENCE_S)
    warming.join(STOP_PATIENCE_S)  # for the processes that compile to be ended, too
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
    leave_at_once()
