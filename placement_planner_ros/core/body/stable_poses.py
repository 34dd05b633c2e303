"""The facets of its hull that a body rests on, and those from which it could roll."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.body.tipping import Index, Tipping

GRAVITY = 9.81
"""m/s²."""

TIPPING_ENERGY = 0.002
"""J/kg that it takes at least to tip a body off a rest: what a push to 63 mm/s gives it, or 0.2 mm
of height. Of boxes 21 to 30 mm thin, scanned with noise of 1 mm, nine sides in ten take as much,
and all where the noise is half that; facets that noise leaves on a round side take less."""

LEFT_REST_RAD, ROCKING_RAD = 0.35, 0.12
"""Radians: a body that turned by more than the first has left its rest. Half that energy must not
turn it by more than the second, or it would not stay where it is put."""

ROLLING_RAD, LEVEL_SHARE = 1.05, 0.04
"""A body rolls where it can turn by more than that, radians, while its height changes by less than
this share of it: 0.035 is what a prism of 12 sides rises by, 0.042 one of 11."""

NOISE_SHARE = 0.1
"""Share of the height up to which a rise may be taken for noise: cubes rise by 0.41 of it."""

ROUND_SIDE_SPACING_RAD = 0.8
"""Radians between rests of one round side."""

ROUNDING_M = 1e-6
"""m by which corners differ, and valleys along a round side are deep, that are no rounding."""


@dataclass(frozen=True, slots=True)
class StablePose:
    """A side to rest on.

    Attributes:
        facet: of the hull.
        rolls: whether it could roll from there, or rock widely.
    """

    facet: int
    rolls: bool


def stable_poses(tipping: Tipping, flatness: float, merge_angle: float) -> tuple[StablePose, ...]:
    """Every side that the body rests on, in the order of the hull's facets.

    Args:
        flatness: metres by which a surface that is meant to be even may not be; so much does not
            keep a body from rolling.
        merge_angle: radians within which the lowest rest stands for all.
    """
    # Valleys deep enough to hold the body, firmly or not.
    bottoms = tipping.valleys(ROUNDING_M)
    found = [
        _rest_on(tipping, int(facet), bottoms, flatness)
        for facet in tipping.valleys(TIPPING_ENERGY / GRAVITY)
    ]
    # Firm rests first; of round sides only what is far from these.
    firm = _spread_rests(tipping, [rest for rest in found if not rest.rolls], merge_angle)
    round_ = {
        each.facet: each
        for rest in found
        if rest.rolls
        for each in _rests_of_round_side(tipping, rest, bottoms, flatness)
    }
    clear = [rest for rest in round_.values() if _is_apart(tipping, rest, firm, merge_angle)]
    return tuple(
        sorted(
            [*firm, *_spread_rests(tipping, clear, ROUND_SIDE_SPACING_RAD)],
            key=lambda rest: rest.facet,
        )
    )


def _rest_on(tipping: Tipping, facet: int, bottoms: Index, flatness: float) -> StablePose:
    height, rise = float(tipping.heights[facet]), TIPPING_ENERGY / GRAVITY
    # A push may turn it off the rest, or set it rocking.
    rolls = tipping.turns(facet, height + rise, LEFT_REST_RAD)
    rolls = rolls or tipping.turns(facet, height + 0.5 * rise, ROCKING_RAD)
    return StablePose(facet, rolls or _rolls_on(tipping, facet, bottoms, flatness))


def _rolls_on(tipping: Tipping, facet: int, bottoms: Index, flatness: float) -> bool:
    """Whether the body could roll on from a facet to others on which it could stay as well.

    What topples over an edge keeps its height for a while, too, but stays nowhere on the way.

    Args:
        bottoms: facets on which it could stay if nothing moved it.
    """
    # Facets on the way at about that height, and how far it turned there.
    level = tipping.around(facet, *_height_band(float(tipping.heights[facet]), flatness))
    turned = tipping.normals[bottoms[level[bottoms]]] @ tipping.normals[facet]
    return bool(turned.min(initial=1.0) < np.cos(ROLLING_RAD))


def _height_band(height: float, flatness: float) -> tuple[float, float]:
    """Lowest and highest of a body that rolls from that height, metres."""
    change = max(min(flatness, NOISE_SHARE * height), LEVEL_SHARE * height)
    return height - change, height + change


def _rests_of_round_side(
    tipping: Tipping, rest: StablePose, bottoms: Index, flatness: float
) -> Iterator[StablePose]:
    """All rests of the round side that this one is on."""
    yield rest
    level = tipping.around(rest.facet, *_height_band(float(tipping.heights[rest.facet]), flatness))
    for facet in bottoms[level[bottoms]].tolist():
        yield StablePose(facet, rolls=True)


def _spread_rests(tipping: Tipping, given: list[StablePose], apart: float) -> list[StablePose]:
    """Of rests within that angle of each other, radians, the lowest."""
    kept: list[StablePose] = []
    for rest in sorted(given, key=lambda rest: float(tipping.heights[rest.facet])):
        if _is_apart(tipping, rest, kept, apart):
            kept.append(rest)
    return kept


def _is_apart(tipping: Tipping, rest: StablePose, others: list[StablePose], angle: float) -> bool:
    """Whether a rest is further than that from all others, radians."""
    if not others:
        return True
    normals = tipping.normals[[other.facet for other in others]]
    apart = np.linalg.norm(normals - tipping.normals[rest.facet], axis=1).min()
    return bool(2.0 * np.arcsin(min(0.5 * float(apart), 1.0)) > angle)
