"""Bins, trays and shelves: is there room for the object, and for the hand?"""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.situations.situation import (
    BOX_LYING,
    BOX_ON_EDGE,
    BOX_ON_END,
    DARK,
    SMALL_BOX,
    UPRIGHT,
    WOOD,
    Draw,
    Limits,
    ObjectStance,
    Situation,
    SituationKind,
    place,
    slab,
    standing,
    walls,
)
from placement_planner_ros.scenes.primitives import box

Rng = np.random.Generator
LARGE, SMALL = "large_crayons_box", "small_crayons_box"
_DECK = 0.16
"""m, height of a shelf's lower board."""


def _bin(
    kind: SituationKind,
    sides: tuple[Limits, ...],
    height: Limits,
    rng: Rng,
    yaw: float = 0.0,
    robot_can: bool = True,
) -> Situation:
    """A bin on the table, square where one side is given; V is its inside, just above its floor."""
    drawn = [rng.uniform(*side) for side in sides]
    length, width, high = drawn[0], drawn[-1], rng.uniform(*height)
    centre = place(rng)
    solids = walls("bin", centre, (length, width), high)
    sized = kind.sized(width=width, height=high)
    volume = slab(centre, (length / 2, width / 2), 0.0)
    return sized.drawn(volume, solids, centre, yaw=yaw, robot_can=robot_can)


def _in_bin(name: str, thing: str, why: str, stance: ObjectStance | None = None) -> SituationKind:
    return SituationKind(name, "bins", thing, why, stance)


def box_under_bars(rng: Rng) -> Situation:
    """Only lying does the box fit under the bars, and so held the lower finger is in the floor."""
    centre, height = place(rng), rng.uniform(0.055, 0.065)
    half = 0.10
    low, high = centre[0] - half - 0.01, centre[0] + half + 0.01
    roof = [
        box(f"roof_{k}", (low, y - 0.004, height), (high, y + 0.004, height + 0.008), DARK)
        for k, y in enumerate(np.linspace(centre[1] - 0.09, centre[1] + 0.09, 10))
    ]
    solids = (*walls("bin", centre, (2 * half, 2 * half), height), *roof)
    why = "closed by bars: the box could lie below them, but nothing leads there"
    kind = _in_bin("box_under_bars", LARGE, why, BOX_LYING)
    volume = slab(centre, (half, half), 0.0)
    return kind.drawn(volume, solids, centre, robot_can=False, spacing=0.004)


def glass_on_tray(rng: Rng) -> Situation:
    (x, y), rim = place(rng), rng.uniform(0.010, 0.015)
    length, width = rng.uniform(0.16, 0.20), rng.uniform(0.14, 0.16)
    low = (x - length / 2 - 0.006, y - width / 2 - 0.006, 0.0)
    high = (x + length / 2 + 0.006, y + width / 2 + 0.006, 0.006)
    sides = walls("tray", (x, y), (length, width), rim, 0.006, 0.006)
    solids = (box("tray/floor", low, high, DARK), *sides)
    kind = SituationKind("glass_on_tray", "trays", "wine_glass", "room within the rim", UPRIGHT)
    return kind.drawn(slab((x, y), (length / 2, width / 2), 0.006), solids, (x, y), 0.006)


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
    centre, height = place(rng), rng.uniform(0.06, 0.08)
    rim = rng.uniform(*rims)
    volume = slab(centre, (inner[0] / 2 + rim, inner[1] / 2 + rim), height)
    return kind.drawn(volume, walls("bin", centre, inner, height, rim), centre, height)


def box_on_rim(rng: Rng) -> Situation:
    """The rim alone is in V."""
    centre, height = place(rng), rng.uniform(0.05, 0.07)
    inner, rim = rng.uniform(0.16, 0.18), rng.uniform(0.009, 0.012)
    why = "a rim of {rim:.0f} mm: even across a corner the box needs 15 mm"
    kind = SituationKind("box_on_rim", "rims", SMALL, why).sized(rim=rim)
    volume = slab(centre, (inner / 2 + rim, inner / 2 + rim), height)
    return kind.drawn(volume, walls("bin", centre, (inner, inner), height, rim), centre)


def _shelf(kind: SituationKind, headroom: Limits, rng: Rng) -> Situation:
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
    volume = slab(centre, (0.15 / 2, half), _DECK)
    witness = None if kind.stance is None else standing(centre, _DECK, kind.stance)
    eye = (-0.05, centre[1], 0.30)  # looks in from the front
    return kind.sized(room=room).in_scene(volume, solids, witness, eye=eye)


def _in_shelf(
    name: str, thing: str, headroom: Limits, why: str, stance: ObjectStance | None = None
) -> Draw:
    why = f"{{room:{'.1f' if headroom[1] < 0.1 else '.0f'}}} mm below the board{why}"
    return partial(_shelf, SituationKind(name, "shelves", thing, why, stance), headroom)


SITUATIONS: tuple[Draw, ...] = (
    partial(
        _bin,
        _in_bin("box_in_bin", SMALL,
                "room for the box, and for the fingers that open beside it", SMALL_BOX),
        ((0.15, 0.17), (0.13, 0.15)), (0.045, 0.060),
    ),
    partial(
        _bin,
        _in_bin("box_in_slot", SMALL,
                "the slot is 23 to 27 mm wider than the box, its walls end below the fingers",
                SMALL_BOX),
        ((0.13, 0.15), (0.044, 0.048)), (0.012, 0.018),
    ),
    partial(
        _bin,
        _in_bin("slot_too_narrow", SMALL,
                "the slot is {width:.1f} mm wide, the box 21 mm on its thinnest side"),
        ((0.13, 0.15), (0.016, 0.0195)), (0.012, 0.018),
    ),
    partial(
        _bin,
        _in_bin("slot_too_deep", SMALL,
                "walls of {height:.0f} mm, {width:.0f} mm apart: fingers reach down to 56 mm at "
                "the highest, and need 45 mm", SMALL_BOX),
        ((0.11, 0.13), (0.036, 0.040)), (0.080, 0.095), robot_can=False,
    ),
    partial(
        _bin,
        _in_bin("box_across_bin", LARGE, "too long for the bin but along its diagonal",
                BOX_ON_END),
        ((0.136, 0.144),), (0.045, 0.060), yaw=np.pi / 4,
    ),
    partial(
        _bin,
        _in_bin("bin_too_small", LARGE,
                "{width:.0f} mm square: the box needs 113 mm, along the diagonal"),
        ((0.105, 0.110),), (0.045, 0.060),
    ),
    partial(
        _bin,
        _in_bin("box_in_deep_bin", LARGE, "on its edge, held above the walls", BOX_ON_EDGE),
        ((0.19, 0.21), (0.11, 0.13)), (0.065, 0.075),
    ),
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
