"""What is measured in other processes: the node, which knows ROS, and the independent checker."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import placement_planner_ros
from benchmarks.speed.rows import Entry

_ROOT = Path(placement_planner_ros.__file__).parent.parent
_TESTS = _ROOT / "test"
_VERIFY = """
import json, sys
from pathlib import Path
from by_hand.verify_cases import verify
runs, refusals = verify(Path(sys.argv[1]))
checked = sum(len(run["solutions"]) for run in runs)
told = {"row": "checked", "checked": checked, "refused": len(refusals), "refusals": refusals}
print(json.dumps(told))
"""


def measure_node(stops: int, minutes: float, seed: int) -> Iterator[Entry]:
    """What `benchmarks.node.node_speed` tells.

    Raises:
        RuntimeError: it could not measure the node.
    """
    options = ("--stops", str(stops), "--minutes", str(minutes), "--seed", str(seed))
    return _told("-m", "benchmarks.node.node_speed", *options)


def measure_load(seed: int) -> Iterator[Entry]:
    """What `benchmarks.node.node_load` tells.

    Raises:
        RuntimeError: it could not measure the node.
    """
    return _told("-m", "benchmarks.node.node_load", "--seed", str(seed))


def check_recorded(folder: Path) -> Iterator[Entry]:
    """How many of the placements in a folder `test/by_hand/verify_cases.py` refuses.

    Nothing where there is no checkout; an entry with `error` where it did not come to an end.
    """
    if (_TESTS / "by_hand" / "verify_cases.py").exists():
        try:
            yield from _told("-c", _VERIFY, str(folder))
        except RuntimeError as error:
            yield {"row": "checked", "error": str(error)}


def _told(*command: str) -> Iterator[Entry]:
    """The JSON lines that a Python command prints, as they come."""
    known = filter(None, [str(_ROOT), str(_TESTS), os.environ.get("PYTHONPATH")])
    with tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(
            [sys.executable, *command],
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(known)},
        )
        assert process.stdout is not None
        with process:
            for line in process.stdout:
                if line.startswith("{"):
                    yield json.loads(line)
        if process.returncode != 0:
            errors.seek(0)
            raise RuntimeError((errors.read().strip() or "no answer").splitlines()[-1])
