"""Bins, trays, shelves, frames and walls: is there room for the object, and for the hand?

Hollow objects stand beside and over things that their hulls would meet, and they do not.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from benchmarks.situations.situation import (
    BOX_LYING,
    BOX_ON_EDGE,
    BOX_ON_END,
    DARK,
    SMALL_BOX,
    THING,
    TRAY_UPSIDE_DOWN,
    UPRIGHT,
    WOOD,
    Draw,
    Limits,
    ObjectStance,
    Situation,
    SituationKind,
    four_walls,
    slab_around,
    some_place,
    standing_pose,
)
from placement_planner_ros.scenes.primitives import box, frustum, standing_box

Rng = np.random.Generator
LARGE, SMALL = "large_crayons_box", "small_crayons_box"
_TOP = 0.06
"""m, height of a board that something stands on."""
_DECK = 0.16
"""m, height of a shelf's lower board."""


def _in_bin(
    name: str,
    thing: str,
    why: str,
    sizes: tuple[Limits, ...],
    stance: ObjectStance | None = None,
    **given: Any,
) -> Draw:
    """A bin on the table of that length, width (none where it is square) and height; V is its
    inside, just above its floor."""
    kind = SituationKind(name, "bins", thing, why, stance)

    def draw(rng: Rng) -> Situation:
        *sides, high = (rng.uniform(*size) for size in sizes)
        length, width, centre = sides[0], sides[-1], some_place(rng)
        solids = four_walls("bin", centre, (length, width), high)
        volume = slab_around(centre, (length / 2, width / 2), 0.0)
        return kind.sized(width=width, height=high).drawn(volume, solids, centre, **given)

    return draw


def box_under_bars(rng: Rng) -> Situation:
    """Only lying does the box fit under the bars, and so held the lower finger is in the floor."""
    centre, height = some_place(rng), rng.uniform(0.055, 0.065)
    half = 0.10
    low, high = centre[0] - half - 0.01, centre[0] + half + 0.01
    roof = [
        box(f"roof_{k}", (low, y - 0.004, height), (high, y + 0.004, height + 0.008), DARK)
        for k, y in enumerate(np.linspace(centre[1] - 0.09, centre[1] + 0.09, 10))
    ]
    solids = (*four_walls("bin", centre, (2 * half, 2 * half), height), *roof)
    why = "closed by bars: the box could lie below them, but nothing leads there"
    kind = SituationKind("box_under_bars", "bins", LARGE, why, BOX_LYING)
    volume = slab_around(centre, (half, half), 0.0)
    return kind.drawn(volume, solids, centre, robot_can=False, spacing=0.004)


def glass_on_tray(rng: Rng) -> Situation:
    (x, y), rim = some_place(rng), rng.uniform(0.010, 0.015)
    length, width = rng.uniform(0.16, 0.20), rng.uniform(0.14, 0.16)
    low = (x - length / 2 - 0.006, y - width / 2 - 0.006, 0.0)
    high = (x + length / 2 + 0.006, y + width / 2 + 0.006, 0.006)
    sides = four_walls("tray", (x, y), (length, width), rim, 0.006, 0.006)
    solids = (box("tray/floor", low, high, DARK), *sides)
    kind = SituationKind("glass_on_tray", "trays", "wine_glass", "room within the rim", UPRIGHT)
    return kind.drawn(slab_around((x, y), (length / 2, width / 2), 0.006), solids, (x, y), 0.006)


def tray_on_rim(rng: Rng) -> Situation:
    kind = SituationKind("tray_on_rim", "rims", "tray", "all four corners on the rim", UPRIGHT)
    return _tray_over(kind, (0.132, 0.094), (0.027, 0.029), rng)


def tray_over_opening(rng: Rng) -> Situation:
    side = rng.uniform(0.188, 0.194)
    why = "an opening {side:.0f} mm square; the tray is 186 mm from corner to corner"
    kind = SituationKind("tray_over_opening", "rims", "tray", why).sized(side=side)
    return _tray_over(kind, (side, side), (0.019, 0.021), rng)


def _tray_over(
    kind: SituationKind, inner: tuple[float, float], rims: Limits, rng: Rng
) -> Situation:
    centre, height = some_place(rng), rng.uniform(0.06, 0.08)
    rim = rng.uniform(*rims)
    volume = slab_around(centre, (inner[0] / 2 + rim, inner[1] / 2 + rim), height)
    return kind.drawn(volume, four_walls("bin", centre, inner, height, rim), centre, height)


def box_on_rim(rng: Rng) -> Situation:
    """The rim alone is in V."""
    centre, height = some_place(rng), rng.uniform(0.05, 0.07)
    inner, rim = rng.uniform(0.16, 0.18), rng.uniform(0.009, 0.012)
    why = "a rim of {rim:.0f} mm: even across a corner the box needs 15 mm"
    kind = SituationKind("box_on_rim", "rims", SMALL, why).sized(rim=rim)
    volume = slab_around(centre, (inner / 2 + rim, inner / 2 + rim), height)
    return kind.drawn(volume, four_walls("bin", centre, (inner, inner), height, rim), centre)


def _under_board(kind: SituationKind, headroom: Limits, rng: Rng) -> Situation:
    """Open to the robot's side; V is what is under its board."""
    room = rng.uniform(*headroom)
    front, y = rng.uniform(0.38, 0.40), rng.uniform(-0.10, 0.10)
    back, half, roof = front + 0.15, 0.16, _DECK + room
    solids = (
        box("deck", (front, y - half, -0.04), (back, y + half, _DECK), WOOD),
        box("roof", (front, y - half, roof), (back, y + half, roof + 0.012), WOOD),
        box("back", (back, y - half, _DECK), (back + 0.012, y + half, roof + 0.012), WOOD),
        box("side_1", (front, y + half, _DECK), (back, y + half + 0.012, roof + 0.012), WOOD),
        box("side_2", (front, y - half - 0.012, _DECK), (back, y - half, roof + 0.012), WOOD),
    )
    centre = (front + 0.15 / 2, y)
    volume = slab_around(centre, (0.15 / 2, half), _DECK)
    witness = None if kind.stance is None else standing_pose(centre, _DECK, kind.stance)
    eye = (-0.05, centre[1], 0.30)  # looks in from the front
    return kind.sized(room=room).in_scene(volume, solids, witness, eye=eye)


def _in_shelf(
    name: str, thing: str, headroom: Limits, why: str, stance: ObjectStance | None = None
) -> Draw:
    why = f"{{room:{'.1f' if headroom[1] < 0.1 else '.0f'}}} mm below the board{why}"
    return partial(_under_board, SituationKind(name, "shelves", thing, why, stance), headroom)


SITUATIONS: tuple[Draw, ...] = (
    _in_bin("box_in_bin", SMALL, "room for the box, and for the fingers that open beside it",
            ((0.15, 0.17), (0.13, 0.15), (0.045, 0.060)), SMALL_BOX),
    _in_bin("box_in_slot", SMALL,
            "the slot is 23 to 27 mm wider than the box, its walls end below the fingers",
            ((0.13, 0.15), (0.044, 0.048), (0.012, 0.018)), SMALL_BOX),
    _in_bin("slot_too_narrow", SMALL,
            "the slot is {width:.1f} mm wide, the box 21 mm on its thinnest side",
            ((0.13, 0.15), (0.016, 0.0195), (0.012, 0.018))),
    _in_bin("slot_too_deep", SMALL,
            "walls of {height:.0f} mm, {width:.0f} mm apart: fingers reach down to 56 mm at the "
            "highest, and need 45 mm",
            ((0.11, 0.13), (0.036, 0.040), (0.080, 0.095)), SMALL_BOX, robot_can=False),
    _in_bin("box_across_bin", LARGE, "too long for the bin but along its diagonal",
            ((0.136, 0.144), (0.045, 0.060)), BOX_ON_END, yaw=np.pi / 4),
    _in_bin("bin_too_small", LARGE,
            "{width:.0f} mm square: the box needs 113 mm, along the diagonal",
            ((0.105, 0.110), (0.045, 0.060))),
    _in_bin("box_in_deep_bin", LARGE, "on its edge, held above the walls",
            ((0.19, 0.21), (0.11, 0.13), (0.065, 0.075)), BOX_ON_EDGE),
    box_under_bars, glass_on_tray, tray_on_rim, tray_over_opening, box_on_rim,
    _in_shelf("glass_in_shelf", "wine_glass", (0.170, 0.180),
              ": the glass, 10 mm to come down, and the margin", UPRIGHT),
    _in_shelf("shelf_too_low_for_glass", "wine_glass", (0.138, 0.143),
              ", the glass is 145 mm high; lying it would roll"),
    _in_shelf("box_in_shelf", LARGE, (0.155, 0.165),
              ": the box on its edge, 124 mm high", BOX_ON_EDGE),
    _in_shelf("shelf_too_low_for_box", LARGE, (0.0325, 0.035),
              ", the box is 36 mm high as it lies"),
)  # fmt: skip


def _hollow_kind(
    name: str, thing: str, why: str, stance: ObjectStance | None = None
) -> SituationKind:
    return SituationKind(name, "hollow things", thing, why, stance)


def _bowl_in_frame(kind: SituationKind, halves: Limits, heights: Limits, rng: Rng) -> Situation:
    half, height, centre = rng.uniform(*halves), rng.uniform(*heights), some_place(rng)
    solids = four_walls("frame", centre, (2 * half, 2 * half), height)
    return kind.sized(width=2 * half).drawn(slab_around(centre, (half, half), 0.0), solids, centre)


def _toy_table(
    kind: SituationKind, board: tuple[Limits, Limits], can: tuple[Limits, Limits], rng: Rng
) -> Situation:
    """Over a can of a radius and height, on a board of two sides."""
    long, wide, radius, height = (rng.uniform(*each) for each in (*board, *can))
    centre = some_place(rng)
    solids = (
        standing_box("board", (long, wide, _TOP), centre, 0.0, 0.0, DARK),
        frustum("can", (radius, radius), (_TOP, _TOP + height), THING, centre),
    )
    volume = slab_around(centre, (long / 2, wide / 2), _TOP)
    return kind.sized(height=height, wide=wide).drawn(volume, solids, centre, _TOP)


def tray_over_can(rng: Rng) -> Situation:
    """Margins off, 27 mm are left beside the can, on which the tray does not stand on its end."""
    centre, radius = some_place(rng), rng.uniform(0.0465, 0.0475)
    board = rng.uniform(0.1575, 0.159), rng.uniform(0.1175, 0.119)
    can = frustum("can", (radius, radius), (_TOP, _TOP + rng.uniform(0.016, 0.020)), THING, centre)
    solids = (standing_box("board", (*board, _TOP), centre, 0.0, 0.0, DARK), can)
    why = "upside down it would stand over the can; held by its wall the hand is then below"
    kind = _hollow_kind("tray_over_can", "tray", why, TRAY_UPSIDE_DOWN)
    volume = slab_around(centre, (board[0] / 2, board[1] / 2), _TOP)
    return kind.drawn(volume, solids, centre, _TOP, robot_can=False)


def _mug_between(kind: SituationKind, gaps: Limits, rng: Rng) -> Situation:
    gap, (x, y), height, long = rng.uniform(*gaps), some_place(rng), rng.uniform(0.045, 0.055), 0.14
    apart = gap / 2 + 0.006
    solids = [
        standing_box(f"wall_{side:+.0f}", (long, 0.012, height), (x, y + side * apart), 0.0, 0.0,
                     THING)
        for side in (-1.0, 1.0)
    ]  # fmt: skip
    volume = slab_around((x, y), (long / 2 - 0.015, gap / 2), 0.0)
    return kind.sized(gap=gap).drawn(volume, solids, (x - 0.025, y), yaw=np.pi)


HOLLOW_THINGS: tuple[Draw, ...] = (
    partial(
        _bowl_in_frame,
        _hollow_kind("bowl_over_frame", "bowl",
                     "the rim of 120 mm is above the frame, the foot of 72 mm within", UPRIGHT),
        (0.056, 0.059), (0.010, 0.013),
    ),
    partial(
        _bowl_in_frame,
        _hollow_kind("bowl_in_high_frame", "bowl",
                     "the bowl is 111 mm wide where a frame of {width:.0f} mm ends"),
        (0.049, 0.052), (0.030, 0.034),
    ),
    partial(
        _toy_table,
        _hollow_kind("toy_table_over_can", "toy_table", "no room beside the can, but over it",
                     UPRIGHT),
        ((0.122, 0.126), (0.084, 0.088)), ((0.013, 0.016), (0.014, 0.018)),
    ),
    partial(
        _toy_table,
        _hollow_kind("toy_table_over_high_can", "toy_table",
                     "a can of {height:.0f} mm under a plate at 67 mm; lying it needs 70 mm, of "
                     "which the board has {wide:.0f}"),
        ((0.110, 0.114), (0.0665, 0.0690)), ((0.018, 0.021), (0.069, 0.072)),
    ),
    tray_over_can,
    partial(
        _mug_between,
        _hollow_kind("mug_between_walls", "mug",
                     "{gap:.0f} mm between the walls: the handle must point along them", UPRIGHT),
        (0.096, 0.102),
    ),
    partial(
        _mug_between,
        _hollow_kind("walls_too_near_for_mug", "mug",
                     "{gap:.1f} mm between the walls, the mug is 80 mm wide"),
        (0.0745, 0.078),
    ),
)  # fmt: skip
