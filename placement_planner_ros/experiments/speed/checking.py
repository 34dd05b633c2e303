"""The independent checker, where a checkout of the project is at hand."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import placement_planner_ros
from placement_planner_ros.experiments.speed.rows import Entry

_ROOT = Path(placement_planner_ros.__file__).parent.parent
_VERIFY = """
import json, sys
from pathlib import Path
from verify_cases import verify
runs, refusals = verify(Path(sys.argv[1]))
checked = sum(len(run["solutions"]) for run in runs)
print(json.dumps({"checked": checked, "refused": len(refusals), "refusals": refusals}))
"""


def check_recorded(folder: Path) -> Entry | None:
    """How many of the placements in a folder `test/verify_cases.py` refuses.

    Returns:
        None where there is no checkout; an entry with `error` where it did not come to an end.
    """
    tests = _ROOT / "test"
    if not (tests / "verify_cases.py").exists():
        return None
    path = os.pathsep.join(filter(None, [str(_ROOT), str(tests), os.environ.get("PYTHONPATH")]))
    ended = subprocess.run(
        [sys.executable, "-c", _VERIFY, str(folder)],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    if ended.returncode != 0:
        return {"row": "checked", "error": (ended.stderr.strip() or "no answer").splitlines()[-1]}
    return {"row": "checked", **json.loads(ended.stdout.splitlines()[-1])}
