"""Hollow objects beside and over things: their hulls would meet what they do not."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.situations.situation import (
    DARK,
    THING,
    TRAY_UPSIDE_DOWN,
    UPRIGHT,
    Draw,
    Limits,
    ObjectStance,
    Situation,
    SituationKind,
    place,
    slab,
    walls,
)
from placement_planner_ros.scenes.primitives import frustum, standing_box

Rng = np.random.Generator
_TOP = 0.06
"""m, height of a board that something stands on."""


def _hollow(name: str, thing: str, why: str, stance: ObjectStance | None = None) -> SituationKind:
    return SituationKind(name, "hollow things", thing, why, stance)


def _bowl(kind: SituationKind, halves: Limits, heights: Limits, rng: Rng) -> Situation:
    half, height, centre = rng.uniform(*halves), rng.uniform(*heights), place(rng)
    solids = walls("frame", centre, (2 * half, 2 * half), height)
    return kind.sized(width=2 * half).drawn(slab(centre, (half, half), 0.0), solids, centre)


def _toy_table(
    kind: SituationKind, board: tuple[Limits, Limits], can: tuple[Limits, Limits], rng: Rng
) -> Situation:
    """Over a can of a radius and height, on a board of two sides."""
    long, wide, radius, height = (rng.uniform(*each) for each in (*board, *can))
    centre = place(rng)
    solids = (
        standing_box("board", (long, wide, _TOP), centre, 0.0, 0.0, DARK),
        frustum("can", radius, radius, _TOP, _TOP + height, THING, centre),
    )
    volume = slab(centre, (long / 2, wide / 2), _TOP)
    return kind.sized(height=height, wide=wide).drawn(volume, solids, centre, _TOP)


def tray_over_can(rng: Rng) -> Situation:
    """Margins off, 27 mm are left beside the can, on which the tray does not stand on its end."""
    centre, radius = place(rng), rng.uniform(0.0465, 0.0475)
    board = rng.uniform(0.1575, 0.159), rng.uniform(0.1175, 0.119)
    can = frustum("can", radius, radius, _TOP, _TOP + rng.uniform(0.016, 0.020), THING, centre)
    solids = (standing_box("board", (*board, _TOP), centre, 0.0, 0.0, DARK), can)
    why = "upside down it would stand over the can; held by its wall the hand is then below"
    kind = _hollow("tray_over_can", "tray", why, TRAY_UPSIDE_DOWN)
    volume = slab(centre, (board[0] / 2, board[1] / 2), _TOP)
    return kind.drawn(volume, solids, centre, _TOP, robot_can=False)


def _mug(kind: SituationKind, gaps: Limits, rng: Rng) -> Situation:
    gap, (x, y), height, long = rng.uniform(*gaps), place(rng), rng.uniform(0.045, 0.055), 0.14
    apart = gap / 2 + 0.006
    solids = [
        standing_box(f"wall_{side:+.0f}", (long, 0.012, height), (x, y + side * apart), 0.0, 0.0,
                     THING)
        for side in (-1.0, 1.0)
    ]  # fmt: skip
    volume = slab((x, y), (long / 2 - 0.015, gap / 2), 0.0)
    return kind.sized(gap=gap).drawn(volume, solids, (x - 0.025, y), yaw=np.pi)


SITUATIONS: tuple[Draw, ...] = (
    partial(_bowl, _hollow("bowl_over_frame", "bowl", "the rim of 120 mm is above the frame, the "
                           "foot of 72 mm within", UPRIGHT), (0.056, 0.059), (0.010, 0.013)),
    partial(_bowl, _hollow("bowl_in_high_frame", "bowl",
                           "the bowl is 111 mm wide where a frame of {width:.0f} mm ends"),
            (0.049, 0.052), (0.030, 0.034)),
    partial(_toy_table, _hollow("toy_table_over_can", "toy_table",
                                "no room beside the can, but over it", UPRIGHT),
            ((0.122, 0.126), (0.084, 0.088)), ((0.013, 0.016), (0.014, 0.018))),
    partial(_toy_table, _hollow("toy_table_over_high_can", "toy_table",
                                "a can of {height:.0f} mm under a plate at 67 mm; lying it needs "
                                "70 mm, of which the board has {wide:.0f}"),
            ((0.110, 0.114), (0.0665, 0.0690)), ((0.018, 0.021), (0.069, 0.072))),
    tray_over_can,
    partial(_mug, _hollow("mug_between_walls", "mug", "{gap:.0f} mm between the walls: the handle "
                          "must point along them", UPRIGHT), (0.096, 0.102)),
    partial(_mug, _hollow("walls_too_near_for_mug", "mug",
                          "{gap:.1f} mm between the walls, the mug is 80 mm wide"),
            (0.0745, 0.078)),
)  # fmt: skip
