"""How many are solved, and how much longer the first placement takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np


def markdown(entries: Sequence[Mapping[str, Any]]) -> str:
    """A table, one row for each limit and kind of start."""
    lines = [
        "| limit | starts | runs | solved without a limit | solved with it | first placement "
        "without, s: median | with, s: median, worst | ratio: median, 95 % | "
        "ratio of the searches alone | motions, s: without, with |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    kinds = sorted({(e["degrees"], e["opposite"]) for e in entries}, reverse=True)
    for degrees, opposite in kinds:
        made = [
            e
            for e in entries
            if (e["degrees"], e["opposite"]) == (degrees, opposite) and not e["failure"]
        ]
        both = [e for e in made if e["free"]["found"] and e["limited"]["found"]]
        if not both:
            continue
        free, limited = (np.array([e[name]["time"] for e in both]) for name in ("free", "limited"))
        moved = [np.median([e[name]["duration"] for e in both]) for name in ("free", "limited")]
        ratio = limited / free
        environment = np.array([e["environment"] for e in both])
        search = (limited - environment) / (free - environment)
        lines.append(
            f"| {degrees:g}° | {'opposite' if opposite else 'near'} | {len(made)} "
            f"| {sum(e['free']['found'] for e in made)} "
            f"| {sum(e['limited']['found'] for e in made)} | {np.median(free):.2f} "
            f"| {np.median(limited):.2f}, {limited.max():.2f} "
            f"| {np.median(ratio):.2f}, {np.quantile(ratio, 0.95):.2f} "
            f"| {np.median(search):.2f}, {np.quantile(search, 0.95):.2f} "
            f"| {moved[0]:.1f}, {moved[1]:.1f} |"
        )
    return "\n".join(lines) + "\n"
