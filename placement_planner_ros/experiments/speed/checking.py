"""The independent checker, where a checkout of the project is at hand."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import placement_planner_ros
from placement_planner_ros.experiments.speed.rows import Entry

_ROOT = Path(placement_planner_ros.__file__).parent.parent


def check_recorded(folder: Path) -> Entry | None:
    """How many of the placements in a folder `test/verify_cases.py` refuses.

    Returns:
        None where there is no checkout; an entry with `error` where it did not come to an end.
    """
    script = _ROOT / "test" / "verify_cases.py"
    if not script.exists():
        return None
    path = os.pathsep.join(filter(None, [str(_ROOT), os.environ.get("PYTHONPATH", "")]))
    ended = subprocess.run(
        [sys.executable, str(script), str(folder)],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    found = re.search(r"(\d+) solutions of \d+ runs, (\d+) refused", ended.stdout)
    if found is None:
        return {"row": "checked", "error": (ended.stderr.strip() or "no answer").splitlines()[-1]}
    return {
        "row": "checked",
        "checked": int(found[1]),
        "refused": int(found[2]),
        "refusals": [line for line in ended.stdout.splitlines() if ".npz:" in line],
    }
