"""What figures were measured with: machine, versions, the state of the sources and the day."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

import placement_planner_ros
from placement_planner_ros.experiments.machine import machine, versions
from placement_planner_ros.experiments.speed.rows import Entry

MADE_WITH = "made_with"
"""`row` of an entry that belongs to the rows it lists."""


def made_with(rows: Sequence[str]) -> Entry:
    """An entry that says it of these rows."""
    return {
        "row": MADE_WITH,
        "rows": list(rows),
        "day": time.strftime("%Y-%m-%d"),
        "commit": commit(),
        **machine(),
        **versions(),
    }


def commit() -> str:
    """Of the checkout that the package is imported from, marked where files were changed."""
    folder = Path(placement_planner_ros.__file__).parent
    try:
        asked = subprocess.run(
            ["git", "-C", str(folder), "describe", "--always", "--dirty"],
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return "no checkout"
    return asked.stdout.strip()
