"""All situations, drawn anew by a seed."""

from __future__ import annotations

import numpy as np

from benchmarks.situations import containers, slopes, supports, volumes
from benchmarks.situations.situation import Situation
from placement_planner_ros.core.errors import ParameterError

_DRAWS = (
    *slopes.SITUATIONS,
    *containers.SITUATIONS,
    *supports.SITUATIONS,
    *containers.HOLLOW_THINGS,
    *volumes.SITUATIONS,
)


def all_situations(rng: np.random.Generator) -> dict[str, Situation]:
    """Name -> situation. Each draws from a generator of its own, so that none depends on others."""
    drawn = [draw(own) for draw, own in zip(_DRAWS, rng.spawn(len(_DRAWS)), strict=True)]
    return {situation.name: situation for situation in drawn}


def situation_by_name(name: str, seed: int) -> Situation:
    """One of those that a seed draws.

    Raises:
        ParameterError: no such situation; the message lists those there are.
    """
    known = all_situations(np.random.default_rng(seed))
    if name not in known:
        raise ParameterError("situation", name, f"choose one of {', '.join(known)}")
    return known[name]
