"""Latencies and memory of the real node, as JSON lines on standard output.

`python -m benchmarks speed` starts this as a process of its own, since the rest of the benchmark
does without ROS. It starts the node and a publisher of a bundled scene, each as a process, in a
namespace of its own and on this machine only, and calls services as a client would.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from benchmarks.machine import resident_megabytes
from placement_planner_ros.client import Answer, PlacementError, Status
from placement_planner_ros.client.conversation import parameter_message
from placement_planner_ros.ros.qos import LATCHED
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.share import share_path

NAMESPACE = f"/placement_speed_{os.getpid()}"
"""So that two of these beside each other do not meet."""
SCENE, OBJECT = "cabinet_high_clutter", "small_crayons_box"
_COMMON = ("--ros-args", "-r", f"__ns:={NAMESPACE}", "--log-level", "warn")
_READY_WITHIN = 600.0
"""Seconds until the node is warm; after installation it first compiles its kernels."""
_ANSWER_WITHIN = 10.0
_FIRST_WITHIN = 10.0
"""Seconds a first placement may take before it counts as not found."""
_PERIOD = 0.2
"""Seconds between service calls, and between readings of memory, during a search."""


class NodeSpeedError(Exception):
    """The node could not be measured."""


class NodeCaller(Node):
    """Calls the node's services and notes when results arrive."""

    def __init__(self) -> None:
        super().__init__("placement_caller", namespace=NAMESPACE)
        self.warm = False
        self.state: tuple[int, str] = (0, "")
        self.first: dict[int, float] = {}
        planner = "placement_planner"
        self.start = self.create_client(SetParametersAtomically, f"{planner}/start_with")
        self.stop = self.create_client(Trigger, f"{planner}/stop")
        self.start_again = self.create_client(Trigger, f"{planner}/start")
        self.parameters = self.create_client(GetParameters, f"{planner}/get_parameters")
        self.create_subscription(DiagnosticStatus, f"{planner}/status", self._on_status, LATCHED)
        self.create_subscription(DiagnosticArray, f"{planner}/solution", self._on_solution, LATCHED)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self)

    def _on_status(self, message: DiagnosticStatus) -> None:
        status = Status.of(message)
        self.warm = status.values["warm"] == "true"
        self.state = status.run, status.state

    def _on_solution(self, message: DiagnosticArray) -> None:
        values = {v.key: v.value for v in message.status[0].values}
        if values["solution"] != "0":
            self.first.setdefault(int(values["run"]), time.perf_counter())

    def call(self, client: Client, request: Any) -> tuple[Any, float, float]:
        """The answer, when it was asked for, and the seconds it took.

        Raises:
            NodeSpeedError: none came.
        """
        asked = time.perf_counter()
        future = client.call_async(request)
        while not future.done():
            if time.perf_counter() - asked > _ANSWER_WITHIN:
                raise NodeSpeedError(f"no answer from {client.srv_name}")
            self._executor.spin_once(timeout_sec=0.01)
        return future.result(), asked, time.perf_counter() - asked

    def begin(self, seed: int) -> tuple[int, float, float]:
        """The number of a run, when it was asked for, and the seconds until that was answered.

        Raises:
            PlacementError: it was refused.
        """
        request = SetParametersAtomically.Request(parameters=[parameter_message("seed", seed)])
        response, asked, seconds = self.call(self.start, request)
        answer = Answer.of(response)
        if not answer.success or answer.run is None:
            raise answer.error
        return answer.run, asked, seconds

    def spin(self, seconds: float) -> None:
        """Take what arrives."""
        end = time.perf_counter() + seconds
        while (left := end - time.perf_counter()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def wait(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Whether it came true in time."""
        end = time.perf_counter() + seconds
        while not condition():
            if time.perf_counter() > end:
                return False
            self._executor.spin_once(timeout_sec=0.01)
        return True


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stops", type=int, default=20, help="runs stopped at a random moment")
    parser.add_argument("--minutes", type=float, default=1.0, help="of one search, for memory")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    scene = ["-m", "placement_planner_ros", "placement_scene", *_COMMON]
    scene += ["-p", f"name:={SCENE}", "-p", f"object:={OBJECT}"]

    def measure(processes: Sequence[subprocess.Popen[bytes]]) -> None:
        _tell_latencies(NodeCaller(), processes[0], options)

    return measure_processes([node_command(), scene], measure)


def measure_processes(
    commands: Sequence[Sequence[str]], measure: Callable[[Sequence[subprocess.Popen[bytes]]], None]
) -> int:
    """Run Python commands beside each other while measuring; 1 where that failed."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init()
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "node.log"
        with log.open("wb") as stream:
            processes = [
                subprocess.Popen([sys.executable, *command], stdout=stream, stderr=stream)
                for command in commands
            ]
        try:
            measure(processes)
        except (NodeSpeedError, PlacementError) as error:
            print(f"{log.read_text(errors='replace')[-2000:]}\n{error}", file=sys.stderr)
            return 1
        finally:
            for process in processes:
                process.send_signal(signal.SIGINT)
            for process in processes:
                try:
                    process.wait(10.0)
                except subprocess.TimeoutExpired:
                    process.kill()
            rclpy.try_shutdown()
    return 0


def node_command() -> list[str]:
    """Starts the node for the scene; its runs go on until they are stopped."""
    volume = scene_by_name(SCENE).volume
    corners = [*volume.lower.tolist(), *volume.upper.tolist()]
    return [
        *("-m", "placement_planner_ros", "placement_planner", *_COMMON),
        *("--params-file", str(share_path("config", f"{OBJECT}.yaml"))),
        *("-p", f"target_volume:={corners}", "-p", "time_limit:=0.0"),
    ]


def _tell_latencies(
    caller: NodeCaller, process: subprocess.Popen[bytes], options: argparse.Namespace
) -> None:
    wait_until_ready(caller, process)
    rng = np.random.default_rng(options.seed)
    for number in range(options.stops):
        run, asked = _timed_start(caller, int(rng.integers(1000)))
        caller.spin(float(rng.uniform(0.0, 2.0)))
        if number % 2:  # every other one is stopped wherever it is, the rest after a placement
            left = _FIRST_WITHIN - (time.perf_counter() - asked)
            solved = caller.wait(lambda run=run: run in caller.first, left)  # type: ignore[misc]
            seconds = caller.first[run] - asked if solved else _FIRST_WITHIN
            tell_entry(kind="first", seconds=seconds, solved=solved)
        report_stop(caller)
    _tell_search(caller, process, options.minutes)


def wait_until_ready(caller: NodeCaller, process: subprocess.Popen[bytes]) -> None:
    """Wait for the kernels, and for the inputs: a run that is not measured.

    Raises:
        NodeSpeedError: the node has ended, or does not get ready.
    """

    def ready() -> bool:
        if process.poll() is not None:
            raise NodeSpeedError(f"the node ended with code {process.returncode}")
        return caller.warm and caller.start.service_is_ready()

    if not caller.wait(ready, _READY_WITHIN):
        raise NodeSpeedError(f"the node did not get ready within {_READY_WITHIN:g} s")
    end = time.perf_counter() + 30.0
    while True:
        try:
            run, _, _ = caller.begin(0)
            break
        except PlacementError:
            if time.perf_counter() > end:
                raise
        caller.spin(0.2)
    if not caller.wait(lambda: run in caller.first, 60.0):
        raise NodeSpeedError("the first run found no placement in 60 s")
    caller.call(caller.stop, Trigger.Request())


def _timed_start(caller: NodeCaller, seed: int) -> tuple[int, float]:
    """The run's number and when it was asked for; its latency is told."""
    run, asked, seconds = caller.begin(seed)
    tell_entry(kind="start", seconds=seconds)
    return run, asked


def report_stop(caller: NodeCaller, row: str = "node") -> None:
    """`~/stop` answers once the run has ended, or after a second that it has not."""
    answer, asked, seconds = caller.call(caller.stop, Trigger.Request())
    code = Answer.of(answer).code
    if code == "STOPPING":
        if not caller.wait(lambda: caller.state[1] == "stopped", _ANSWER_WITHIN):
            raise NodeSpeedError(f"a worker has not ended {_ANSWER_WITHIN:g} s after stop")
        seconds = time.perf_counter() - asked
    elif code != "OK":
        raise NodeSpeedError(f"stop is refused: {answer.message}")
    tell_entry(row, kind="stop", seconds=seconds)


def _tell_search(caller: NodeCaller, process: subprocess.Popen[bytes], minutes: float) -> None:
    """One long search: memory, and the latency of services beside it."""
    _timed_start(caller, 0)
    started = time.perf_counter()
    requests: list[tuple[Client, Any]] = [
        (caller.parameters, GetParameters.Request(names=["time_limit"])),
        (caller.start_again, Trigger.Request()),
    ]
    number = 0
    while (elapsed := time.perf_counter() - started) < 60.0 * minutes:
        client, request = requests[number % len(requests)]
        number += 1
        _, _, seconds = caller.call(client, request)
        tell_entry(kind="service", seconds=seconds, service=client.srv_name.split("/")[-1])
        used = 1e6 * resident_megabytes(process.pid)
        tell_entry(row="memory", time=elapsed, bytes=used)
        caller.spin(_PERIOD)
    report_stop(caller)


def tell_entry(row: str = "node", **values: object) -> None:
    """Print an entry."""
    print(json.dumps({"row": row, **values}), flush=True)


if __name__ == "__main__":
    sys.exit(main())
