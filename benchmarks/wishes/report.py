"""Relative objectives of weighted sums."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.wishes.mixtures import MIXTURES


def relative(entry: Mapping[str, Any]) -> list[float]:
    """Of each run: 0 is a random placement, 1 the best of the dense search and of the runs; a run
    without a placement counts as 0. Empty where the dense search has nothing to compare with."""
    found = [run["best"] for run in entry["runs"] if run["best"] is not None]
    random = entry["random"]
    if entry["best"] is None or random is None:
        return []
    best = max([entry["best"], *found])
    if best - random < 1e-6:
        return []
    return [
        0.0 if run["best"] is None else max(0.0, (run["best"] - random) / (best - random))
        for run in entry["runs"]
    ]


def markdown(entries: Sequence[Mapping[str, Any]]) -> str:
    """A table, one row for each mixture and one of all."""
    lines = [
        "| mixture | cases | runs | mean relative objective | worst | runs above 0.95 "
        "| dense search cut off |",
        "|---|---|---|---|---|---|---|",
    ]
    made = [entry for entry in entries if not entry["failure"]]
    for name in (*MIXTURES, "all"):
        of = [entry for entry in made if name in (entry["mixture"], "all")]
        values = np.array([value for entry in of for value in relative(entry)])
        if len(values):
            lines.append(
                f"| {name} | {len(of)} | {len(values)} | {values.mean():.3f} | {values.min():.3f} "
                f"| {int((values >= 0.95).sum())} | {sum(not e['complete'] for e in of)} |"
            )
    return "\n".join(lines) + "\n"
