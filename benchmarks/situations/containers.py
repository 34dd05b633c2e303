"""Bins, trays and shelves: is there room for the object, and for the hand?"""

from __future__ import annotations

import numpy as np

from benchmarks.situations.situation import (
    BOX_LYING,
    BOX_ON_EDGE,
    BOX_ON_END,
    DARK,
    SMALL_BOX,
    UPRIGHT,
    WOOD,
    Point,
    Rest,
    Situation,
    place,
    slab,
    standing,
    table,
    walls,
)
from placement_planner_ros.scenes.primitives import box
from placement_planner_ros.scenes.scenes import Scene

Rng = np.random.Generator


def _bin(name: str, rng: Rng, inner: tuple[float, float], height: float) -> tuple[Scene, Point]:
    """A bin on the table; V is its inside, just above its floor."""
    centre = place(rng)
    solids = (table(), *walls("bin", centre, inner, height))
    return Scene(name, slab(centre, (inner[0] / 2, inner[1] / 2), 0.0), solids), centre


def box_in_bin(rng: Rng) -> Situation:
    inner = rng.uniform(0.15, 0.17), rng.uniform(0.13, 0.15)
    scene, centre = _bin("box_in_bin", rng, inner, rng.uniform(0.045, 0.060))
    why = "room for the box, and for the fingers that open beside it"
    pose = standing(centre, rest=SMALL_BOX)
    return Situation("box_in_bin", "bins", "small_crayons_box", scene, why, pose)


def box_in_slot(rng: Rng) -> Situation:
    inner = rng.uniform(0.13, 0.15), rng.uniform(0.044, 0.048)
    scene, centre = _bin("box_in_slot", rng, inner, rng.uniform(0.012, 0.018))
    why = "the slot is 23 to 27 mm wider than the box, its walls end below the fingers"
    pose = standing(centre, rest=SMALL_BOX)
    return Situation("box_in_slot", "bins", "small_crayons_box", scene, why, pose)


def slot_too_narrow(rng: Rng) -> Situation:
    inner = rng.uniform(0.13, 0.15), rng.uniform(0.016, 0.0195)
    scene, _ = _bin("slot_too_narrow", rng, inner, rng.uniform(0.012, 0.018))
    why = f"the slot is {1e3 * inner[1]:.1f} mm wide, the box 21 mm on its thinnest side"
    return Situation("slot_too_narrow", "bins", "small_crayons_box", scene, why)


def slot_too_deep(rng: Rng) -> Situation:
    inner = rng.uniform(0.11, 0.13), rng.uniform(0.036, 0.040)
    height = rng.uniform(0.080, 0.095)
    scene, centre = _bin("slot_too_deep", rng, inner, height)
    why = (
        f"walls of {1e3 * height:.0f} mm, {1e3 * inner[1]:.0f} mm apart: fingers reach down to "
        "56 mm at the highest, and need 45 mm"
    )
    pose = standing(centre, rest=SMALL_BOX)
    name = "slot_too_deep"
    return Situation(name, "bins", "small_crayons_box", scene, why, pose, robot_can=False)


def box_across_bin(rng: Rng) -> Situation:
    side = rng.uniform(0.136, 0.144)
    scene, centre = _bin("box_across_bin", rng, (side, side), rng.uniform(0.045, 0.060))
    why = "too long for the bin but along its diagonal"
    pose = standing(centre, rest=BOX_ON_END, yaw=np.pi / 4)
    return Situation("box_across_bin", "bins", "large_crayons_box", scene, why, pose)


def bin_too_small(rng: Rng) -> Situation:
    side = rng.uniform(0.105, 0.110)
    scene, _ = _bin("bin_too_small", rng, (side, side), rng.uniform(0.045, 0.060))
    why = f"{1e3 * side:.0f} mm square: the box needs 113 mm, along the diagonal"
    return Situation("bin_too_small", "bins", "large_crayons_box", scene, why)


def box_in_deep_bin(rng: Rng) -> Situation:
    inner = rng.uniform(0.19, 0.21), rng.uniform(0.11, 0.13)
    scene, centre = _bin("box_in_deep_bin", rng, inner, rng.uniform(0.065, 0.075))
    why = "on its edge, held above the walls"
    pose = standing(centre, rest=BOX_ON_EDGE)
    return Situation("box_in_deep_bin", "bins", "large_crayons_box", scene, why, pose)


def box_under_bars(rng: Rng) -> Situation:
    """Only lying does the box fit under the bars, and so held the lower finger is in the floor."""
    centre, height = place(rng), rng.uniform(0.055, 0.065)
    half = 0.10
    roof = [
        box(
            f"roof_{k}",
            (centre[0] - half - 0.01, y - 0.004, height),
            (centre[0] + half + 0.01, y + 0.004, height + 0.008),
            DARK,
        )
        for k, y in enumerate(np.linspace(centre[1] - 0.09, centre[1] + 0.09, 10))
    ]
    inner = (2 * half, 2 * half)
    solids = (table(), *walls("bin", centre, inner, height), *roof)
    scene = Scene("box_under_bars", slab(centre, (half, half), 0.0), solids)
    why = "closed by bars: the box could lie below them, but nothing leads there"
    pose = standing(centre, rest=BOX_LYING)
    return Situation(
        "box_under_bars", "bins", "large_crayons_box", scene, why, pose, robot_can=False,
        spacing=0.004,
    )  # fmt: skip


def glass_on_tray(rng: Rng) -> Situation:
    centre, rim = place(rng), rng.uniform(0.010, 0.015)
    inner = rng.uniform(0.16, 0.20), rng.uniform(0.14, 0.16)
    low = (centre[0] - inner[0] / 2 - 0.006, centre[1] - inner[1] / 2 - 0.006, 0.0)
    high = (centre[0] + inner[0] / 2 + 0.006, centre[1] + inner[1] / 2 + 0.006, 0.006)
    floor = box("tray/floor", low, high, DARK)
    solids = (table(), floor, *walls("tray", centre, inner, rim, 0.006, 0.006))
    scene = Scene("glass_on_tray", slab(centre, (inner[0] / 2, inner[1] / 2), 0.006), solids)
    why = "room within the rim"
    pose = standing(centre, 0.006)
    return Situation("glass_on_tray", "trays", "wine_glass", scene, why, pose)


def tray_on_rim(rng: Rng) -> Situation:
    return _tray_over(rng, "tray_on_rim", 0.132, 0.094, "all four corners on the rim")


def tray_over_opening(rng: Rng) -> Situation:
    side = rng.uniform(0.188, 0.194)
    why = f"an opening {1e3 * side:.0f} mm square; the tray is 186 mm from corner to corner"
    return _tray_over(rng, "tray_over_opening", side, side, why)


def _tray_over(rng: Rng, name: str, length: float, width: float, why: str) -> Situation:
    centre, height = place(rng), rng.uniform(0.06, 0.08)
    rim = rng.uniform(0.027, 0.029) if name == "tray_on_rim" else rng.uniform(0.019, 0.021)
    solids = (table(), *walls("bin", centre, (length, width), height, rim))
    volume = slab(centre, (length / 2 + rim, width / 2 + rim), height)
    pose = standing(centre, height) if name == "tray_on_rim" else None
    return Situation(name, "rims", "tray", Scene(name, volume, solids), why, pose)


def box_on_rim(rng: Rng) -> Situation:
    """The rim alone is in V."""
    centre, height = place(rng), rng.uniform(0.05, 0.07)
    inner, rim = rng.uniform(0.16, 0.18), rng.uniform(0.009, 0.012)
    solids = (table(), *walls("bin", centre, (inner, inner), height, rim))
    volume = slab(centre, (inner / 2 + rim, inner / 2 + rim), height)
    scene = Scene("box_on_rim", volume, solids)
    why = f"a rim of {1e3 * rim:.0f} mm: even across a corner the box needs 15 mm"
    return Situation("box_on_rim", "rims", "small_crayons_box", scene, why)


def _shelf(name: str, headroom: float, depth: float, rng: Rng) -> tuple[Scene, Point]:
    """Open to the robot's side; V is what is under its board."""
    front, y, deck = rng.uniform(0.38, 0.40), rng.uniform(-0.10, 0.10), 0.16
    back, half = front + depth, 0.16
    roof = deck + headroom
    solids = (
        box("deck", (front, y - half, -0.04), (back, y + half, deck), WOOD),
        box("roof", (front, y - half, roof), (back, y + half, roof + 0.012), WOOD),
        box("back", (back, y - half, deck), (back + 0.012, y + half, roof + 0.012), WOOD),
        box("side_1", (front, y + half, deck), (back, y + half + 0.012, roof + 0.012), WOOD),
        box("side_2", (front, y - half - 0.012, deck), (back, y - half, roof + 0.012), WOOD),
    )
    centre = (front + depth / 2, y)
    return Scene(name, slab(centre, (depth / 2, half), deck), solids), centre


def _in_shelf(
    name: str, thing: str, rng: Rng, headroom: float, why: str, rest: Rest | None
) -> Situation:
    scene, centre = _shelf(name, headroom, 0.15, rng)
    witness = None if rest is None else standing(centre, 0.16, rest)
    eye = (-0.05, centre[1], 0.30)  # looks in from the front
    return Situation(name, "shelves", thing, scene, why, witness, eye=eye)


def glass_in_shelf(rng: Rng) -> Situation:
    room = rng.uniform(0.170, 0.180)
    why = f"{1e3 * room:.0f} mm below the board: the glass, 10 mm to come down, and the margin"
    return _in_shelf("glass_in_shelf", "wine_glass", rng, room, why, UPRIGHT)


def shelf_too_low_for_glass(rng: Rng) -> Situation:
    room = rng.uniform(0.138, 0.143)
    why = f"{1e3 * room:.0f} mm below the board, the glass is 145 mm high; lying it would roll"
    return _in_shelf("shelf_too_low_for_glass", "wine_glass", rng, room, why, None)


def box_in_shelf(rng: Rng) -> Situation:
    room = rng.uniform(0.155, 0.165)
    why = f"{1e3 * room:.0f} mm below the board: the box on its edge, 124 mm high"
    return _in_shelf("box_in_shelf", "large_crayons_box", rng, room, why, BOX_ON_EDGE)


def shelf_too_low_for_box(rng: Rng) -> Situation:
    room = rng.uniform(0.0325, 0.035)
    why = f"{1e3 * room:.1f} mm below the board, the box is 36 mm high as it lies"
    return _in_shelf("shelf_too_low_for_box", "large_crayons_box", rng, room, why, None)


SITUATIONS = (
    box_in_bin, box_in_slot, slot_too_narrow, slot_too_deep, box_across_bin, bin_too_small,
    box_in_deep_bin, box_under_bars, glass_on_tray, tray_on_rim, tray_over_opening, box_on_rim,
    glass_in_shelf, shelf_too_low_for_glass, box_in_shelf, shelf_too_low_for_box,
)  # fmt: skip
