"""What figures were measured with: machine, versions, the state of the sources and the day."""

from __future__ import annotations

import time
from collections.abc import Sequence

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
        **machine(),
        **versions(),
    }
