"""The real node beside three clouds of 300,000 points at 10 Hz, as JSON lines on standard output.

How long start and stop take to answer, and how many samples of a search the clouds cost.
`python -m benchmarks speed --rows load` starts this as a process of its own.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from benchmarks.node.cloud_load import TOPICS
from benchmarks.node.node_speed import (
    NAMESPACE,
    OBJECT,
    SCENE,
    NodeCaller,
    NodeSpeedError,
    measure_processes,
    node_command,
    report_stop,
    tell_entry,
    wait_until_ready,
)
from placement_planner_ros.client import Status
from placement_planner_ros.ros.qos import LATCHED

_SETTLED = 1.0
"""Seconds after which the clouds come, or come no more."""
_TURN = 3.0
"""Seconds that clouds come, or do not, while samples are counted."""
_SEARCH = 48.0
"""Seconds of a search with clouds in turns."""
_PAUSE = 0.15
"""Seconds between calls."""


class LoadCaller(NodeCaller):
    """Also turns the clouds of `cloud_load` on and off, and counts samples."""

    def __init__(self) -> None:
        super().__init__()
        self.counts: list[tuple[float, int]] = []
        self._load = self.create_publisher(Bool, "load", LATCHED)

    def load(self, on: bool) -> None:
        """Have the three clouds published, or not."""
        self._load.publish(Bool(data=on))

    def _on_status(self, message: DiagnosticStatus) -> None:
        now = time.perf_counter()
        super()._on_status(message)
        status = Status.of(message)
        self.counts.append((now, int(status.values.get("samples", 0))))


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=100, help="starts and stops")
    parser.add_argument("--searches", type=int, default=2, help="of 48 s, clouds in turns")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    # The three cameras are silent for longer than their clouds would do.
    topics = ["-p", f"cloud_topics:=[{','.join(TOPICS)}]", "-p", "cloud.max_age:=0.0"]
    load = ["-m", "benchmarks.node.cloud_load", SCENE, OBJECT]
    load += ["--ros-args", "-r", f"__ns:={NAMESPACE}", "--log-level", "warn"]

    def measure(processes: Sequence[subprocess.Popen[bytes]]) -> None:
        caller = LoadCaller()
        wait_until_ready(caller, processes[0])
        rng = np.random.default_rng(options.seed)
        _tell_calls(caller, options.calls, rng)
        _tell_samples(caller, options.searches)

    return measure_processes([node_command() + topics, load], measure)


def _tell_calls(caller: LoadCaller, number: int, rng: np.random.Generator) -> None:
    """Starts and stops beside the clouds, stopped anywhere in the first half second."""
    caller.load(True)
    caller.spin(2.0)
    for _ in range(number):
        _, _, seconds = caller.begin(int(rng.integers(1000)))
        tell_entry("load", kind="start", seconds=seconds)
        caller.spin(float(rng.uniform(0.0, 0.5)))
        report_stop(caller, "load")
        caller.spin(_PAUSE)


def _tell_samples(caller: LoadCaller, searches: int) -> None:
    """Samples per second while clouds come and while none do, in turns within one search."""
    for number in range(searches):
        caller.load(False)
        caller.spin(_SETTLED)
        begin_search(caller, number)
        rates: dict[bool, list[float]] = {False: [], True: []}
        end = time.perf_counter() + _SEARCH
        clouds = bool(number % 2)
        while time.perf_counter() < end:
            caller.load(clouds)
            caller.spin(_SETTLED)
            caller.counts.clear()
            caller.spin(_TURN)
            (begun, before), (ended, after) = caller.counts[0], caller.counts[-1]
            rates[clouds].append((after - before) / (ended - begun))
            clouds = not clouds
        caller.call(caller.stop, Trigger.Request())
        caller.wait(lambda: caller.state[1] == "stopped", 5.0)
        without, beside = (float(np.mean(rates[clouds])) for clouds in (False, True))
        tell_entry("load", kind="samples", without=without, beside=beside, turns=len(rates[True]))
    caller.load(False)


def begin_search(caller: LoadCaller, seed: int) -> None:
    """Start a run, and wait for its first placement.

    Raises:
        NodeSpeedError: there is none.
    """
    run, _, _ = caller.begin(seed)
    if not caller.wait(lambda: run in caller.first, 20.0):
        raise NodeSpeedError("no placement was found in 20 s")


if __name__ == "__main__":
    sys.exit(main())
