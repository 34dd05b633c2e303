"""The facets of its hull that a body rests on, and those from which it could roll."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.body.tipping import Tipping
from placement_planner_ros.core.types import SINGLE_ROUNDING

TIPPING_RISE_M = 0.0002
"""m that a body's centre of mass must rise at least for it to leave a rest: a push to 63 mm/s lifts
it by that. Of boxes 21 to 30 mm thin, scanned with noise of 1 mm, nine sides in ten hold as firmly,
and all where the noise is half that; facets that noise leaves on a round side do not."""

ROLLING_RAD = 1.05
"""A body rolls where it can turn by more than that, radians, at about the same height; rests of one
round side are that far apart."""

LEVEL_SHARE = 0.04
"""Share of its height that is about the same: 0.035 is what a prism of 12 sides rises by, 0.042 one
of 11."""


def stable_poses(tipping: Tipping, flatness: float, merge_angle: float) -> dict[int, bool]:
    """Every facet of the hull that the body rests on, in their order, and whether it could roll
    from there, or rock widely.

    Args:
        flatness: metres by which a surface that is meant to be even may not be; so much does not
            keep a body from rolling.
        merge_angle: radians within which the lowest rest stands for all. A body that a push turns
            by more is none that rests.
    """
    # Valleys deep enough to hold the body, firmly or not.
    bottoms = tipping.valleys(SINGLE_ROUNDING)
    firm: list[int] = []
    rolling: list[int] = []
    for facet in tipping.valleys(TIPPING_RISE_M).tolist():
        # A push may turn it off the rest; or it rolls on at about its height to where it could stay
        # as well. (What topples over an edge keeps its height, but stays nowhere on the way.)
        height = float(tipping.heights[facet])
        pushed = tipping.around(facet, -np.inf, height + TIPPING_RISE_M)
        change = max(flatness, LEVEL_SHARE * height)
        level = bottoms[tipping.around(facet, height - change, height + change)[bottoms]]
        turned = tipping.turned(facet, pushed)
        if turned > merge_angle or tipping.turned(facet, level) > ROLLING_RAD:
            rolling += [facet, *level.tolist()]
        else:
            firm.append(facet)
    # Firm rests first; of round sides only what is far from these.
    firm = _lowest_apart(tipping, firm, merge_angle)
    clear = [facet for facet in set(rolling) if _is_apart(tipping, facet, firm, merge_angle)]
    rolling = _lowest_apart(tipping, clear, ROLLING_RAD)
    return {facet: facet in rolling for facet in sorted([*firm, *rolling])}


def _lowest_apart(tipping: Tipping, facets: list[int], angle: float) -> list[int]:
    """Of facets within that angle of each other, radians, the lowest."""
    kept: list[int] = []
    for facet in sorted(facets, key=lambda facet: (tipping.heights[facet], facet)):
        if _is_apart(tipping, facet, kept, angle):
            kept.append(facet)
    return kept


def _is_apart(tipping: Tipping, facet: int, others: list[int], angle: float) -> bool:
    """Whether a facet is further than that from all others, radians."""
    cosines = tipping.normals[others] @ tipping.normals[facet]
    return bool(cosines.max(initial=-1.0) < np.cos(angle))
