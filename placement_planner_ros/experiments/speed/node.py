"""The node's latencies and memory, measured in a process that knows ROS."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import placement_planner_ros
from placement_planner_ros.experiments.speed.rows import Entry

_ROOT = Path(placement_planner_ros.__file__).parent.parent


def measure_node(stops: int, minutes: float, seed: int) -> Iterator[Entry]:
    """What `placement_planner_ros.ros.tools.node_speed` tells.

    Raises:
        RuntimeError: it could not measure the node.
    """
    command = [
        *(sys.executable, "-m", "placement_planner_ros.ros.tools.node_speed"),
        *("--stops", str(stops), "--minutes", str(minutes), "--seed", str(seed)),
    ]
    path = os.pathsep.join(filter(None, [str(_ROOT), os.environ.get("PYTHONPATH", "")]))
    with tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            env={**os.environ, "PYTHONPATH": path},
        )
        assert process.stdout is not None
        with process:
            for line in process.stdout:
                if line.startswith("{"):
                    yield json.loads(line)
        if process.returncode != 0:
            errors.seek(0)
            raise RuntimeError((errors.read().strip() or "no answer").splitlines()[-1])
