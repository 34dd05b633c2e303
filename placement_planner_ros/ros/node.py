"""The node `placement_planner`: services, one worker at a time, results as they come."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import sys
import threading
import traceback
from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin
import rclpy
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState, PointCloud2
from shape_msgs.msg import Mesh
from std_msgs.msg import String
from std_srvs.srv import Trigger

from placement_planner_ros.core.errors import (
    JointStateError,
    ObjectError,
    ParameterError,
    PlacementPlannerError,
)
from placement_planner_ros.core.types import Placement
from placement_planner_ros.core.warmup import warm_up
from placement_planner_ros.ros.inputs.cloud_subscriptions import CloudSubscriptions
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.inputs.object_input import NoObjectError
from placement_planner_ros.ros.inputs.robot_input import RobotInput, make_arms, require_known
from placement_planner_ros.ros.inputs.self_filter import outside_robot
from placement_planner_ros.ros.inputs.transforms import Transforms
from placement_planner_ros.ros.outputs.answers import Answer, answer, refusal
from placement_planner_ros.ros.outputs.conversions import mesh_from_message
from placement_planner_ros.ros.outputs.publishing import LATCHED, Outputs
from placement_planner_ros.ros.outputs.reporting import Reporter
from placement_planner_ros.ros.parameters.server import ParameterServer
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.run.planning import Prepare, Prepared, Snapshot
from placement_planner_ros.ros.run.preparation import Preparation
from placement_planner_ros.ros.run.run import Run, State
from placement_planner_ros.ros.run.surroundings import sight_notes
from placement_planner_ros.ros.spinning import callbacks_end, catch_signals, spin_until

STOP_PATIENCE = 1.0
"""Seconds that stop waits for the worker before it answers STOPPING."""

THREADS = 6
ARENAS = 2
"""Heaps of the C library: by default each thread gets its own, most of it never given back."""
SWITCH_INTERVAL = 0.001
"""Seconds after which the planner's thread yields the interpreter to a waiting service."""


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
        self._preparation = Preparation(self._take_inputs, self._has_leisure)
        self._prepare = prepare or self._preparation.prepare
        self._commands = threading.Lock()
        self._run: Run | None = None
        self._said: set[str] = set()
        self._settings = ParameterServer(self)
        transforms = Transforms(self)
        robot = RobotInput(self._settings.current, transforms.pose)
        extra = self._settings.current["cloud_topics"]
        self._inputs = Inputs(
            robot, self._settings.current, extra or ["points"], transforms, self.get_clock()
        )
        self._outputs = Outputs(self)
        self._warm = threading.Event()
        self._reporter = Reporter(
            self, self._outputs, self._inputs, self._settings, self._warm.is_set
        )
        self._settings.check_with(self._check_parameters)
        self._settings.notify(self._on_parameters)
        self._subscribe(robot, list(dict.fromkeys(["points", *extra])))
        self._serve()
        for warning in robot.robot.warnings:
            self.get_logger().info(f"robot: {warning}")
        self._prepare_object()
        self.get_logger().info(
            f"ready for robot {robot.robot.name!r}, planning frame {robot.planning_frame!r}"
        )

    # --- inputs ---------------------------------------------------------------------------------

    def _subscribe(self, robot: RobotInput, topics: Sequence[str]) -> None:
        self._clouds = CloudSubscriptions(self, topics, self._on_cloud)
        self.create_subscription(
            JointState,
            "joint_states",
            self._on_joint_state,
            QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT),
            callback_group=MutuallyExclusiveCallbackGroup(),
        )
        descriptions = MutuallyExclusiveCallbackGroup()
        if robot.follows_topic:
            self.create_subscription(
                String,
                "robot_description",
                lambda message: self._on_description(message, semantic=False),
                LATCHED,
                callback_group=descriptions,
            )
        if robot.follows_semantic_topic:
            self.create_subscription(
                String,
                "robot_description_semantic",
                lambda message: self._on_description(message, semantic=True),
                LATCHED,
                callback_group=descriptions,
            )
        self.create_subscription(
            Mesh,
            "~/object",
            self._on_object,
            LATCHED,
            callback_group=descriptions,
        )

    def _on_cloud(self, topic: str, message: PointCloud2) -> None:
        try:
            self._inputs.take_cloud(topic, message, self._settings.current)
        except PlacementPlannerError as error:
            if self._inputs.clouds.refuse(topic, error):
                self.get_logger().warning(f"cloud on {topic} refused: {error}")

    def _on_joint_state(self, message: JointState) -> None:
        try:
            self._inputs.take_joint_state(message)
        except JointStateError as error:
            self._say_once(f"joint state refused: {error}")
            return
        run = self._run
        if run is not None and self._reporter.has_left_start(run):
            run.end(State.ROBOT_MOVED)

    def _on_description(self, message: String, *, semantic: bool) -> None:
        source = self._inputs.robot
        try:
            robot = (source.set_semantic if semantic else source.set_description)(message.data)
        except PlacementPlannerError as error:
            self.get_logger().error(f"robot description refused: {error}")
            return
        if robot is not None:
            self.get_logger().info(f"took robot {robot.name!r} from its description topic")

    def _on_object(self, message: Mesh) -> None:
        self._inputs.object.set_mesh(*mesh_from_message(message))
        self._prepare_object()

    def _check_parameters(self, names: Sequence[str], parameters: ParameterSet) -> None:
        """Refuse what the robot does not have, and meshes that are no object.

        Vertices and triangles may be set one after the other, so they are checked together only
        when both are given.
        """
        source = self._inputs.robot
        if source.is_given:
            require_known(source.robot, parameters, names)
        if parameters["object.mesh"] and "object.mesh" in names:
            self._inputs.object.body(parameters, ["object.mesh"])
        elif {"object.vertices", "object.triangles"} <= set(names):
            self._inputs.object.body(parameters, names)

    def _on_parameters(self, names: Sequence[str], parameters: ParameterSet) -> None:
        self._inputs.object.parameters_changed(names, parameters)
        if any(name.startswith("object.") for name in names):
            self._prepare_object()

    def _prepare_object(self) -> None:
        """Make the body now, so that start finds it ready; say what is wrong with it."""
        try:
            self._inputs.object.body(self._settings.current)
        except NoObjectError:
            return
        except ObjectError as error:
            self.get_logger().warning(f"object refused: {error}")

    def _take_inputs(self) -> tuple[object, Callable[[], Snapshot | None]]:
        parameters = self._settings.current

        def take() -> Snapshot | None:
            snapshot = self._inputs.snapshot(parameters)
            return None if isinstance(snapshot, list) else snapshot

        return self._inputs.state(parameters), take

    def _has_leisure(self) -> bool:
        return self._warm.is_set() and not self.busy

    def _say_once(self, text: str) -> None:
        if text not in self._said:
            self._said.add(text)
            self.get_logger().warning(text)

    # --- services -------------------------------------------------------------------------------

    def _serve(self) -> None:
        group = ReentrantCallbackGroup()

        def trigger(name: str, act: Callable[[], Answer]) -> None:
            def respond(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
                said = act()
                response.success, response.message = said.success, said.text
                return response

            self.create_service(Trigger, name, respond, callback_group=group)

        def with_parameters(name: str, act: Callable[[Sequence[Parameter]], Answer]) -> None:
            def respond(
                request: SetParametersAtomically.Request,
                response: SetParametersAtomically.Response,
            ) -> SetParametersAtomically.Response:
                said = unreadable(request.parameters)
                if said is None:
                    said = act([Parameter.from_parameter_msg(p) for p in request.parameters])
                response.result.successful, response.result.reason = said.success, said.text
                return response

            self.create_service(SetParametersAtomically, name, respond, callback_group=group)

        trigger("~/start", lambda: self.start([]))
        with_parameters("~/start_with", self.start)
        trigger("~/stop", self.stop)
        with_parameters("~/stop_with", self.stop_with)
        trigger("~/confirm_placed", self.confirm_placed)
        trigger("~/clear_environment", self.clear_environment)

    def start(self, changes: Sequence[Parameter]) -> Answer:
        """Check all inputs and begin a run, with some parameters changed for it alone."""
        with self._commands:
            busy = self._busy()
            if busy is not None:
                return busy
            faults = self._settings.faults(changes)
            if faults:
                return refusal(faults)
            parameters = self._settings.with_changes(changes)
            snapshot = self._inputs.snapshot(parameters, [p.name for p in changes])
            if isinstance(snapshot, list):
                return refusal(snapshot)
            number = 1 if self._run is None else self._run.number + 1
            self._run = Run(number, snapshot, self._prepare, self, self._warm)
            self._outputs.clear(number, snapshot.frame)
            self._reporter.follow(self._run)
            self._run.start()
        words = f"planning for {' or '.join(arm.name for arm in snapshot.arms)}"
        notes = [
            *snapshot.body.warnings,
            *snapshot.robot.limit_violations(snapshot.q_start),
            *sight_notes(snapshot),
        ]
        return answer("OK", "\n".join([words, *notes]), run=number)

    def stop(self) -> Answer:
        """End the run; answers once its worker is idle."""
        run = self._run
        if run is None:
            return answer("NOT_RUNNING", "no run was started", success=True)
        if not run.active:
            return self._outcome("NOT_RUNNING", run)
        run.end(State.STOPPED)
        if not run.wait(STOP_PATIENCE):
            return answer(
                "STOPPING",
                f"the worker has not ended within {STOP_PATIENCE:g} s; it publishes nothing more",
                run=run.number,
            )
        return self._outcome("OK", run)

    def stop_with(self, parameters: Sequence[Parameter]) -> Answer:
        """End one run only."""
        wanted = {p.name: p.value for p in parameters}
        if set(wanted) != {"run"} or type(wanted["run"]) is not int:
            return answer("BAD_PARAMETER", "give one integer parameter, run: the run to stop")
        run = self._run
        if run is None or run.number != wanted["run"]:
            known = "no run was started" if run is None else f"the last run is {run.number}"
            return answer("WRONG_RUN", known, run=wanted["run"])
        return self.stop()

    def confirm_placed(self) -> Answer:
        """The best placement was carried out: the object is part of the environment now."""
        with self._commands:
            busy = self._busy()
            if busy is not None:
                return busy
            run = self._run
            if run is None or run.best is None:
                return answer("NO_OBJECT", "there is no placement that could have been carried out")
            if not run.confirmed:
                self._inputs.confirm(run.best, run.snapshot.body)
            run.confirmed = True
        self._reporter.report()
        return answer("OK", "the object is obstacle and support now", run=run.number)

    def clear_environment(self) -> Answer:
        """Forget accumulated points and confirmed objects."""
        with self._commands:
            busy = self._busy()
            if busy is not None:
                return busy
            self._inputs.clouds.clear()
        return answer("OK", "accumulated points and confirmed objects are forgotten")

    def _busy(self) -> Answer | None:
        run = self._run
        if run is None or not run.active:
            return None
        if run.state is State.STOPPING:
            return answer("STOPPING", "the last run has not ended yet", run=run.number)
        return answer("ALREADY_RUNNING", f"state {run.state}", run=run.number)

    def _outcome(self, code: str, run: Run) -> Answer:
        values: dict[str, object] = {"run": run.number, "solution": run.solutions}
        if run.best is not None:
            values["objective"] = float(run.best.objective)
        return answer(code, f"{run.state}: {run.summary()}", success=True, **values)

    # --- the run's observer, called in its worker thread ------------------------------------------

    def prepared(self, run: Run, prepared: Prepared) -> None:
        """The search begins."""
        for reason in prepared.planner.unusable:
            self.get_logger().warning(f"run {run.number} does without: {reason}")
        self._outputs.environment(run.snapshot, prepared.environment)
        self._reporter.environment_known(run, prepared.environment)
        self._reporter.report()

    def placed(self, run: Run, placement: Placement) -> None:
        """A better placement."""
        self._outputs.solution(run.number, run.solutions, placement, run.elapsed, run.snapshot)

    def changed(self, run: Run) -> None:
        """Another state."""
        if run.state is State.FAILED:
            self.get_logger().error(f"run {run.number} failed: {run.reason}")
        self._reporter.report()

    def warm_up(self) -> None:
        """Compile, or load, what a search needs, before somebody waits for it."""
        try:
            robot = self._inputs.robot.robot
            q = pin.neutral(robot.model)
            outside_robot(np.zeros((1, 3)), robot, q, (), None, 0.0)
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
    def busy(self) -> bool:
        """Whether a worker is still at work, be it told to end or not."""
        return self._run is not None and self._run.active

    @property
    def working(self) -> bool:
        """Whether any thread of its own is still at work."""
        return self.busy or self._preparation.busy

    def close(self) -> None:
        """End the run, if there is one, and publish nothing from now on."""
        run = self._run
        if run is not None and run.active:
            run.end(State.STOPPED)
            run.wait(STOP_PATIENCE)
        self._preparation.close()
        self._reporter.close()


def unreadable(parameters: Sequence[ParameterMessage]) -> Answer | None:
    """A refusal of parameters whose type does not exist."""
    known = {kind.value for kind in Parameter.Type}
    bad = [p for p in parameters if p.value.type not in known]
    if not bad:
        return None
    return refusal([ParameterError(p.name, f"type {p.value.type}", "is no type") for p in bad])


def _share_heaps() -> None:
    """Let threads begun from now on share `ARENAS` heaps, where the C library is glibc."""
    m_arena_max = -8
    with contextlib.suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(m_arena_max, ARENAS)


def _warm_up(node: PlacementPlannerNode) -> None:
    """Warm the node up, then have no garbage collection look at what is loaded by now.

    A full one would take 0.1 s, in which no other thread runs: stop would have to wait for it.
    """
    node.warm_up()
    gc.collect()
    gc.freeze()


def main(args: list[str] | None = None) -> None:
    """Run the node until interrupted."""
    _share_heaps()
    sys.setswitchinterval(SWITCH_INTERVAL)
    asked = catch_signals()
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = PlacementPlannerNode()
    except (PlacementPlannerError, ParameterException, NameValidationException) as error:
        sys.exit(f"placement_planner: {error}")
    executor = MultiThreadedExecutor(num_threads=THREADS)
    executor.add_node(node)
    warming = threading.Thread(target=_warm_up, args=(node,), name="warm-up", daemon=True)
    warming.start()
    spin_until(executor, asked, node.survive)
    node.close()
    working = not callbacks_end(executor, STOP_PATIENCE) or warming.is_alive() or node.working
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
    if working:
        # Ending the interpreter under a thread that is in compiled code aborts the process.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


if __name__ == "__main__":
    main()
