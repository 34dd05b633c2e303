"""The table of what was measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from benchmarks.page import between_marks
from benchmarks.speed.rows import MADE_WITH, Entry, Line


def markdown(lines: Sequence[Line], entries: Sequence[Entry]) -> str:
    """The table, and below it what it was measured with."""
    rows = ["| what | measured | target | met | over |", "|---|---|---|---|---|"]
    rows += [
        f"| {line.what} | {line.shown if math.isfinite(line.value) else 'not measured'} "
        f"| {line.wanted} | {'yes' if line.met else '**no**'} | {line.detail} |"
        for line in lines
    ]
    rows += [
        "",
        f"{sum(line.met for line in lines)} of {len(lines)} targets met. Rates and ratios are of "
        "CPU time of one core (`time.process_time`), medians over cases; latencies are wall time. "
        "Runs and queries without an answer count at their limit.",
    ]
    for made in (entry for entry in entries if entry["row"] == MADE_WITH):
        told = [f"{key} {value}" for key, value in made.items() if key not in ("row", "rows")]
        rows += ["", f"{', '.join(made['rows'])} measured with: {', '.join(told)}."]
    return "\n".join(rows) + "\n"


def fill_page(page: Path, table: str, picture: bytes) -> None:
    """Replace what stands between the page's marks, and its images/speed.png."""
    between_marks(page, table)
    (page.parent / "images").mkdir(exist_ok=True)
    (page.parent / "images" / "speed.png").write_bytes(picture)


def plain_text(lines: Sequence[Line]) -> str:
    """The table for a terminal."""
    width = max((len(line.what) for line in lines), default=0)
    return "\n".join(
        f"{'ok  ' if line.met else 'MISS'} {line.what:<{width}}  "
        f"{line.shown if math.isfinite(line.value) else 'not measured'}  "
        f"(target {line.wanted})\n     {line.detail}"
        for line in lines
    )
